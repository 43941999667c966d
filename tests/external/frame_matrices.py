"""Writes the matrices of tests/external/flexible.toml from the structure in frame.toml.

Usage: frame_matrices.py FRAME.toml NODE… OUT
The rigid bodies that carry the nodes and the beams between them become one flexible body:
OUT-mass.mtx and OUT-stiffness.mtx, rows x, y, z, rx, ry, rz of each node. Nothing is reduced. The
stiffness is that of textbook beams, the mass that of rigid bodies about the nodes.
"""

import sys
import tomllib

import numpy as np
from scipy.io import mmwrite
from scipy.sparse import coo_matrix


def cross(d):
    return np.array([[0, -d[2], d[1]], [d[2], 0, -d[0]], [-d[1], d[0], 0]])


def main():
    path, *names, out = sys.argv[1:]
    with open(path, "rb") as file:
        machine = tomllib.load(file)
    at = {name: np.array(machine["nodes"][name], float) for name in names}
    size = 6 * len(names)
    mass, stiffness = np.zeros((size, size)), np.zeros((size, size))
    for body in machine["bodies"].values():
        for i, name in enumerate(names):
            if name in body["nodes"]:
                arm = np.array(body["cog"]) - at[name]
                own = slice(6 * i, 6 * i + 6)
                # Velocity of the centre of gravity and rotation from those of the node.
                motion = np.eye(6)
                motion[:3, 3:] = -cross(arm)
                of_body = np.diag([body["mass"]] * 3 + list(body["inertia"]))
                mass[own, own] += motion.T @ of_body @ motion
    for beam in machine["beams"].values():
        if not all(name in names for name in beam["nodes"]):
            continue
        ends = [names.index(name) for name in beam["nodes"]]
        p, q = (at[name] for name in beam["nodes"])
        length = np.linalg.norm(q - p)
        x = (q - p) / length
        y = np.array(beam["y_axis"], float)
        z = np.cross(x, y)
        z /= np.linalg.norm(z)
        axes = np.vstack((x, np.cross(z, x), z))
        profile = beam["stiffness"]
        ea, gj = profile["axial"] * length, profile["torsion"] * length
        # In the planes of e3, e4 (about y) and of e5, e6 (about z).
        ei_y, ei_z = (value * length for value in profile["bending"])
        k = np.zeros((12, 12))
        for (a, b), value in {(0, 6): ea / length, (3, 9): gj / length}.items():
            k[np.ix_([a, b], [a, b])] += value * np.array([[1, -1], [-1, 1]])
        bent = lambda s: np.array(
            [
                [12, s * 6 * length, -12, s * 6 * length],
                [s * 6 * length, 4 * length**2, -s * 6 * length, 2 * length**2],
                [-12, -s * 6 * length, 12, -s * 6 * length],
                [s * 6 * length, 2 * length**2, -s * 6 * length, 4 * length**2],
            ]
        ) / length**3
        k[np.ix_([1, 5, 7, 11], [1, 5, 7, 11])] += ei_z * bent(1)
        k[np.ix_([2, 4, 8, 10], [2, 4, 8, 10])] += ei_y * bent(-1)
        turn = np.kron(np.eye(4), axes)
        rows = [6 * end + i for end in ends for i in range(6)]
        stiffness[np.ix_(rows, rows)] += turn.T @ k @ turn
    for name, matrix in (("mass", mass), ("stiffness", stiffness)):
        mmwrite(f"{out}-{name}.mtx", coo_matrix(np.tril(matrix) + np.tril(matrix, -1).T), symmetry="symmetric", precision=17)


main()
