"""Checks the MAT-file of `host-gen plant MODEL --mat FILE` from its matrices alone, with NumPy and
SciPy. Usage: mat_file.py HOST_GEN FOLDER MODEL..., with the program and a folder for its files.

Frequency responses and poles are computed again from A, B, C and D and compared with those of the file
and of `host-gen poles`; the sampled plant is computed from the matrix exponential of the continuous
one."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.linalg import expm

LEGS = 6


def response(system, points):
    """C·(p·1 − A)⁻¹·B + D at every point p, along the last index."""
    a, b, c, d = (system[name] for name in "ABCD")
    one = np.eye(len(a))
    return np.stack([c @ np.linalg.solve(p * one - a, b) + d for p in points], axis=2)


def difference(found, stored):
    """Largest difference at any frequency, relative to the largest entry there."""
    largest = np.abs(stored).max(axis=(0, 1))
    return (np.abs(found - stored).max(axis=(0, 1)) / largest).max()


def within(what, found, tolerance):
    print(f"  {what}: {found:.1e}, at most {tolerance:.0e}")
    assert found <= tolerance, what


def each(matrices, *more):
    """The products of matrices along the last index."""
    for other in more:
        matrices = np.einsum("ijf,jkf->ikf", matrices, other)
    return matrices


def texts(names):
    """A cell array of texts as a list."""
    return [str(name) for name in np.atleast_1d(names)]


def rows(matrix):
    return np.atleast_2d(np.array(matrix))


def named(system):
    """Each input, output and state has an identifier that is legal and its own, and a unit."""
    counts = {
        "input": system["B"].shape[1],
        "output": system["C"].shape[0],
        "state": system["A"].shape[0],
    }
    for signals, expected in counts.items():
        identifiers = texts(system[f"{signals}s"])
        units = texts(system[f"{signals}_units"])
        assert len(identifiers) == len(units) == expected, signals
        assert len(set(identifiers)) == expected, signals
        for name in identifiers:
            assert name.isascii() and name.isidentifier() and len(name) < 64, name
        assert all(units), signals


def discrete_by_exponential(plant, period, delay):
    """The plant between the converters: floor accelerations that are straight between samples, forces
    that act from `delay` after their sample for one period."""
    a, b, c, d = (plant[name] for name in "ABCD")
    n = len(a)
    whole = int(np.floor(delay / period + 1e-9))
    rest = max(delay - whole * period, 0.0)

    def held(time):
        """Transition over a time, and the effect of inputs that are constant meanwhile."""
        big = np.zeros((n + 12, n + 12))
        big[:n, :n], big[:n, n:] = a, b
        big = expm(big * time)
        return big[:n, :n], big[:n, n:]

    floor = np.zeros((n + 12, n + 12))
    floor[:n, :n], floor[:n, n : n + 6] = a, b[:, :6]
    floor[n : n + 6, n + 6 :] = np.eye(6) / period
    floor = expm(floor * period)
    now, end = floor[:n, n : n + 6] - floor[:n, n + 6 :], floor[:n, n + 6 :]
    transition, _ = held(period)
    to_end, after = held(period - rest)
    _, before = held(rest)
    after, before = after[:, 6:], to_end @ before[:, 6:]

    def gain(z):
        one = np.linalg.inv(z * np.eye(n) - transition)
        by_floor = one @ (now + z * end)
        late = z ** -whole
        by_force = one @ (after * late + before * late / z)
        direct = np.hstack([d[:, :6], d[:, 6:] * late / z])
        return c @ np.hstack([by_floor, by_force]) + direct

    return gain


def check(program, folder, model):
    def run(*arguments):
        whole = [program, arguments[0], model, "--format", "json", *arguments[1:]]
        return json.loads(subprocess.run(whole, check=True, stdout=subprocess.PIPE).stdout)

    path = folder / f"{Path(model).stem}.mat"
    printed = run("plant", "--mat", path)
    poles = run("poles")
    file = loadmat(path, simplify_cells=True)
    print(f"{path}: {file['machine']}, {file['feedback']} feedback")
    plant, sampled, law = (file[name] for name in ["plant", "sampled", "controller"])
    for system in plant, sampled, law:
        named(system)
    assert texts(law["inputs"]) == texts(plant["outputs"])[-len(law["inputs"]) :]
    assert texts(law["outputs"]) == texts(plant["inputs"])[LEGS:]
    period, delay = law["sample_time"], law["latch_delay"]
    assert sampled["sample_time"] == period

    for kind in printed["kinds"]:
        if kind["feedback"] == file["feedback"]:
            for name in "ABCD":
                assert (rows(kind[name.lower()]) == plant[name]).all(), name
            assert kind["output_identifiers"] == texts(plant["outputs"])
            assert kind["outputs"] == texts(plant["output_names"])
            assert printed["input_identifiers"] == texts(plant["inputs"])
            print("  A, B, C, D and names: those of the JSON, to the bit")

    # One frequency of five, to be quick.
    stored = {name: values[..., ::5] for name, values in file["response"].items()}
    s = 2j * np.pi * stored["hz"]
    z = np.exp(s * period)
    sensors = len(law["inputs"])
    count = len(plant["C"]) - sensors
    whole = response(plant, s)
    g11, g12 = whole[:count, :LEGS], whole[:count, LEGS:]
    g21, g22 = whole[count:, :LEGS], whole[count:, LEGS:]
    within("G11, open, from A, B, C, D", difference(g11, stored["G11_open"]), 1e-7)
    sampled_whole = response(sampled, z)
    g22_sampled = sampled_whole[count:, LEGS:]
    within("G22, sampled", difference(g22_sampled, stored["G22_sampled"]), 1e-6)
    control = response(law, z)
    within("controller", difference(control, stored["controller"]), 1e-6)
    one = np.eye(LEGS)[:, :, None]

    # The closed loop over one period. The sampled plant has no path straight through from the forces.
    c, b = sampled["C"][count:], sampled["B"][:, LEGS:]
    assert not sampled["D"][:, LEGS:].any()
    closed = np.block(
        [
            [sampled["A"] + b @ law["D"] @ c, b @ law["C"]],
            [law["B"] @ c, law["A"]],
        ]
    )
    eigenvalues = np.linalg.eigvals(closed)
    print(f"  largest eigenvalue of the closed loop: {np.abs(eigenvalues).max():.9f}")
    assert np.abs(eigenvalues).max() < 1 and poles["stable"]
    found = np.log(eigenvalues[np.abs(eigenvalues) > 1e-6]) / period
    listed = np.array([pole["re"] + 1j * pole["im"] for pole in poles["sampled"]])
    assert np.allclose(np.atleast_1d(file["poles"]["sampled"]), listed, rtol=1e-12)
    # The slow poles of equal modes nearly coincide, near z = 1: their condition numbers are 10⁷.
    off = [np.abs(found - pole).min() / abs(pole) for pole in listed]
    within("poles of the closed loop", max(off), 1e-4)
    slow = found[(np.abs(found) < np.pi / period) & (found.imag >= 0)]
    off = [np.abs(listed - pole).min() / abs(pole) for pole in slow]
    within("and none beside those of the JSON", max(off), 1e-4)

    if "G11_ideal" in stored:
        gains = file["gains"]
        first, second = ("K_a", "K_v") if "K_a" in gains else ("K_P", "K_I")
        ideal = -(gains[first][:, :, None] + gains[second][:, :, None] / s)
        force = solved(one - each(ideal, g22), each(ideal, g21))
        g11_ideal = g11 + each(g12, force)
        within("G11, ideal", difference(g11_ideal, stored["G11_ideal"]), 1e-5)

    # Amplifiers and sensors with dynamics have states that the continuous plant lacks.
    states = len(sampled["A"]) - sum(name.startswith("held") for name in sampled["states"])
    if states > len(plant["A"]):
        print("  amplifiers or sensors with dynamics: G11, sampled, not computed from the continuous plant")
        return
    gain = discrete_by_exponential(plant, period, delay)
    exact = np.stack([gain(point) for point in z], axis=2)
    within("sampled plant by the matrix exponential", difference(sampled_whole, exact), 1e-6)
    turn = s * period
    hold = np.exp(-s * delay) * -np.expm1(-turn) / turn
    force = solved(one - each(control, g22_sampled), each(control, g21))
    g11_sampled = g11 + each(g12 * hold, force)
    within("G11, sampled", difference(g11_sampled, stored["G11_sampled"]), 1e-5)
    for name, matrices in [("open", g11), ("sampled", g11_sampled)]:
        largest = np.linalg.norm(np.moveaxis(matrices, 2, 0), 2, axis=(1, 2))
        off = np.abs(largest / stored[f"sigma_max_{name}"] - 1).max()
        within(f"σ_max, {name}", off, 1e-5)


def solved(left, right):
    """left⁻¹·right along the last index."""
    first = [np.moveaxis(m, 2, 0) for m in (left, right)]
    return np.moveaxis(np.linalg.solve(*first), 0, 2)


program, folder, *models = sys.argv[1:]
Path(folder).mkdir(parents=True, exist_ok=True)
for model in models:
    check(program, Path(folder), model)
print("the MAT-files are what their matrices give")
