"""Natural frequencies of a machine file by Exudyn beside those of host-gen.

Usage: exudyn_modes.py HOST_GEN MACHINE.toml [PARTS.toml]
HOST_GEN is the program. PARTS.toml is what Exudyn reads in place of the machine: the parts that a
flexible body is made of.

Exudyn assembles geometrically exact beams and rigid bodies, and knows nothing
of our matrices. Its beams are shear deformable with a constant strain over an
element: bending flexibility L³/12 of each element is missing, and a shear
stiffness of 12·EI/h² puts it back, so that one element is a slender beam.
"""

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import exudyn as exu
import numpy as np
from exudyn.utilities import (
    Beam3D,
    GenericJoint,
    MarkerBodyRigid,
    MarkerNodeRigid,
    NodeRigidBodyRotVecLG,
    ObjectGround,
    RigidBodyInertia,
    RigidBodySpringDamper,
    RotationMatrix2RotationVector,
)

# Both work in double precision on matrices of condition 1e4 or so.
TOLERANCE = 1e-9


def load(path):
    """A machine file with what it is based on."""
    with open(path, "rb") as file:
        machine = tomllib.load(file)
    base = machine.pop("based_on", None)
    return merge(load(path.parent / base), machine) if base else machine


def merge(base, change):
    for key, value in change.items():
        nested = isinstance(value, dict) and isinstance(base.get(key), dict)
        base[key] = merge(base[key], value) if nested else value
    return base


def frame_of(x, y):
    """Rotation matrix with x along a beam or as given, as docs/machine-file.md has it."""
    x = np.array(x, float) / np.linalg.norm(x)
    if y is None:
        up = np.array([0.0, 0.0, 1.0])
        y = np.cross(up, x)
        if np.linalg.norm(y) < 1e-9:
            y = np.array([0.0, 1.0, 0.0])
    z = np.cross(x, y)
    z /= np.linalg.norm(z)
    return np.column_stack((x, np.cross(z, x), z))


def hertz(machine):
    system = exu.SystemContainer().AddSystem()
    nodes = {name: np.array(at, float) for name, at in machine["nodes"].items()}
    # What each node moves with: a rigid body of Exudyn's, and where that is.
    carriers = {}

    def marker(name, at, turn=np.eye(3)):
        """A place with axes that moves with a node."""
        body, reference = carriers[name]
        place = exu.HT(rotation=turn, translation=at - reference)
        return system.AddMarker(MarkerBodyRigid(bodyNumber=body, localHT=place))

    def rigid(mass, inertia, at):
        inertia = np.array(inertia, float)
        if inertia.ndim == 1 and len(inertia) == 3:
            inertia = np.diag(inertia)
        whole = RigidBodyInertia(mass=mass, com=np.zeros(3), inertiaTensor=inertia)
        return system.CreateRigidBody(referencePosition=at, inertia=whole)

    ground = system.AddObject(ObjectGround())
    for name in machine["base"]["nodes"]:
        carriers[name] = (ground, np.zeros(3))
    for body in machine["bodies"].values():
        cog = np.array(body["cog"], float)
        made = rigid(body["mass"], body["inertia"], cog)
        for name in body["nodes"]:
            carriers[name] = (made, cog)
    for point in machine.get("point_masses", {}).values():
        at = nodes[point["node"]]
        made = rigid(point["mass"], point["inertia"], at)
        own = system.AddMarker(MarkerBodyRigid(bodyNumber=made, localPosition=np.zeros(3)))
        if point["node"] in carriers:
            joined = [marker(point["node"], at), own]
            system.AddObject(GenericJoint(markerNumbers=joined))
        else:
            carriers[point["node"]] = (made, at)
    for spring in machine.get("springs", {}).values():
        ends = spring["nodes"]
        middle = sum(nodes[name] for name in ends) / 2
        turn = frame_of(spring.get("x_axis", [1, 0, 0]), spring.get("y_axis"))
        none = [0, 0, 0]
        stiffness = spring.get("stiffness", none) + spring.get("rotational_stiffness", none)
        system.AddObject(
            RigidBodySpringDamper(
                markerNumbers=[marker(name, middle, turn) for name in ends],
                stiffness=np.diag(stiffness),
                damping=np.zeros((6, 6)),
            )
        )
    for name, beam in machine["beams"].items():
        if "joints" in beam:
            # What a joint releases has no mass in Exudyn, whose solver needs some.
            sys.exit(f"beam {name} has joints, which this comparison does not know")
        profile = beam.get("stiffness") or machine["profiles"][beam["profile"]]
        ends = beam["nodes"]
        start, end = (nodes[name] for name in ends)
        length = np.linalg.norm(end - start)
        turn = frame_of(end - start, beam.get("y_axis"))
        vector = list(RotationMatrix2RotationVector(turn))
        section = exu.BeamSection()
        about_y, about_z = (length * x for x in profile["bending"])
        shear = [12 * about_z / length**2, 12 * about_y / length**2]
        section.stiffnessMatrix = np.diag(
            [length * profile["axial"], *shear, length * profile["torsion"], about_y, about_z]
        )
        made = [
            system.AddNode(
                NodeRigidBodyRotVecLG(referenceCoordinates=[*nodes[name], *vector])
            )
            for name in ends
        ]
        system.AddObject(Beam3D(nodeNumbers=made, length=length, sectionData=section))
        for node, name in zip(made, ends):
            own = system.AddMarker(MarkerNodeRigid(nodeNumber=node))
            joined = [marker(name, nodes[name], turn), own]
            system.AddObject(GenericJoint(markerNumbers=joined))
    system.Assemble()
    squares, _ = system.ComputeODE2Eigenvalues()
    return np.sort(np.sqrt(np.abs(squares)) / (2 * np.pi))


def main():
    host_gen, machine, *parts = sys.argv[1:]
    print(machine)
    modes = subprocess.run(
        [host_gen, "modes", machine, "--format", "json"], check=True, stdout=subprocess.PIPE
    )
    ours = np.array([mode["hz"] for mode in json.loads(modes.stdout)["modes"]])
    theirs = hertz(load(Path(*(parts or [machine]))))
    if len(theirs) != len(ours):
        sys.exit(f"Exudyn finds {len(theirs)} modes, host-gen {len(ours)}")
    apart = np.abs(theirs / ours - 1)
    print("    host-gen Hz      Exudyn Hz   relative difference")
    for row in zip(ours, theirs, apart):
        print("{:15.6f}{:15.6f}{:15.1e}".format(*row))
    if apart.max() > TOLERANCE:
        sys.exit(f"apart by {apart.max():.1e}, more than {TOLERANCE}")


main()
