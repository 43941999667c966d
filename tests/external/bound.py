"""The certificates of `host-gen bound`, checked from matrices, table and certificate alone.

Usage: bound.py BOUND.json TABLE.rs FOLDER
BOUND.json is what `host-gen bound MACHINE.toml --format json` prints, TABLE.rs what
`host-gen generate MACHINE.toml --table TABLE.rs` writes, and FOLDER what
`host-gen plant MACHINE.toml --matrix-market FOLDER` writes.

For each mode that couples to no other one (six accelerometers, no lags, a latch delay of whole
periods), the level that the certificate of modal controllers proves is computed again, and ECOS
looks for a better combination of the same terms on a grid of its own.

If the machine, FOLDER/machine.toml, minimises an rms (white floor along x, y and z, six
accelerometers with white noise), what its certificates prove is computed again: at each frequency,
ADMM finds the least of the motion and Re tr(Phi T) with sigma_max(T - c) <= r, from below and above.
Needs numpy, scipy, ecos.
"""

import json
import re
import sys
import tomllib
from pathlib import Path

import ecos
import numpy as np
from scipy import sparse
from scipy.io import mmread
from scipy.linalg import eigvals, expm

bound, table, folder = (Path(name) for name in sys.argv[1:4])
bound = json.loads(bound.read_text())
table = table.read_text()


def matrix(name):
    entries = mmread(folder / f"{name}.mtx")
    return np.asarray(entries.todense() if sparse.issparse(entries) else entries, dtype=float)


A, B, C, D = (matrix(f"acceleration-{name}") for name in "ABCD")
# The forces of the legs on the machine; what bends them is left out, some thousandths.
legs = [matrix(f"force-{name}")[-6:] for name in "CD"]
n = len(A)
T = 1 / bound["sample_rate"]
d = bound["delay_samples"]
Ms = bound["max_sensitivity"]
roll = bound["roll_off"]
reached = bound["design"]["reached"]
numbers = lambda text: [float(x) for x in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", text)]
to_modes, to_legs = (np.array(numbers(text)).reshape(6, 6)
                     for _, text in re.findall(r"(input|output): matrix!\[(.*?)\]", table, re.S))
outputs = len(C) - 6
isolated = bound["isolated_hz"]
E = expm(np.block([[A, B[:, 6:]], [np.zeros((6, n + 6))]]) * T)
Ad, Bd = E[:n, :n], E[:n, n:]


def plant(f):
    """G from the floor and held forces, and P from samples of forces to samples of sensors."""
    s, z = 2j * np.pi * f, np.exp(2j * np.pi * f * T)
    G = C @ np.linalg.solve(s * np.eye(n) - A, B) + D
    P = C[outputs:] @ np.linalg.solve(z * np.eye(n) - Ad, Bd) * z ** (1 - d)
    return G, P + D[outputs:, 6:] * z**-d, (1 - 1 / z) / (s * T) * z ** (1 - d)


def motions(f, k, v):
    """Of mode k: g, and the factor of t in the outputs, for the floor motion v."""
    G, P, hold = plant(f)
    P = to_modes @ P @ to_legs
    sensed = to_modes[k] @ G[outputs:, :6] @ v
    return G[:outputs, :6] @ v, G[:outputs, 6:] @ to_legs[:, k] * hold * sensed / P[k, k]


def whole(f, k, v):
    """Of mode k: the momentum of the whole machine along it without control."""
    G = legs[0] @ np.linalg.solve(2j * np.pi * f * np.eye(n) - A, B) + legs[1]
    return np.linalg.inv(to_legs)[k] @ G[:, :6] @ v


def grid(edges, sharp, per_decade):
    """Gauss nodes on intervals that halve towards edges and resonances."""
    x, w = np.polynomial.legendre.leggauss(6)
    step = np.log(10) * 6 / per_decade
    low, high = np.log(edges[0]), np.log(edges[-1])
    breaks = list(np.linspace(low, high, int((high - low) / step) + 2)) + list(np.log(edges))
    for f, width in sharp:
        size = width / f
        while size < step:
            breaks += [np.log(f) - size, np.log(f) + size]
            size *= 2
        breaks.append(np.log(f))
    breaks = np.unique([b for b in breaks if low <= b <= high])
    breaks = breaks[np.append(True, np.diff(breaks) > 1e-7)]
    half, middle = np.diff(breaks)[:, None] / 2, (breaks[1:] + breaks[:-1])[:, None] / 2
    f = np.exp(middle + half * x)
    weights = (half * w * f).ravel() / edges[-1]
    return np.append(edges[0] / 2, f.ravel()), np.append(edges[0] / edges[-1], weights)


def psi(function, z):
    """The terms of a test function, one column each."""
    delta = z - 1
    columns = []
    for term in function["terms"]:
        (n0, n1), (d0, d1, d2) = term["numerator"], term["denominator"]
        roots = np.roots([d2, d1, d0]) if d2 else np.roots([d1, d0]) if d1 else []
        assert all(abs(1 + r) < 1 for r in roots), "a pole is not stable"
        ratio = (n0 + n1 * delta) / (d0 + d1 * delta + d2 * delta**2)
        columns.append(z ** (function["power"] - term["delay"]) * ratio)
    return np.array(columns).T


def lowest(phi, discs):
    """The least Re(phi·t) in all discs, by the best split of phi into a part for each disc."""
    from scipy.optimize import minimize
    centres, radii = (np.array(x) for x in zip(*discs))
    parts = lambda y: np.append(y.view(complex), phi - y.view(complex).sum())
    negative = lambda y: -np.sum((parts(y) * centres).real - radii * abs(parts(y)))
    if len(discs) == 1:
        return -negative(np.zeros(0))
    starts = [np.zeros(2 * len(discs) - 2)]
    for j in range(len(discs) - 1):
        start = np.zeros(len(discs) - 1, complex)
        start[j] = phi
        starts.append(start.view(float))
    best = min((minimize(negative, y + 1e-9 * abs(phi), method="Powell").fun for y in starts))
    return -best


def corners(phi, discs):
    """The same for all samples at once: lowest points and crossings."""
    c, r = discs
    direction = phi.conj() / abs(phi)
    found = [c[j] - direction * r[j] for j in range(len(c))]
    for i in range(len(c)):
        for j in range(i):
            with np.errstate(invalid="ignore", divide="ignore"):
                gap = c[j] - c[i]
                along = (abs(gap) ** 2 + r[i] ** 2 - r[j] ** 2) / (2 * abs(gap))
                across = np.sqrt((r[i] - along) * (r[i] + along))
                found += [c[i] + gap / abs(gap) * (along + s * 1j * across) for s in (1, -1)]
    value = np.full(len(phi), np.inf)
    for t in found:
        with np.errstate(invalid="ignore"):
            inside = np.all([abs(t - c[j]) <= r[j] * (1 + 1e-9) + 1e-12 for j in range(len(c))], 0)
            value = np.where(inside, np.minimum(value, (phi * t).real), value)
    return value


NONE = 1e9  # The radius of a disc that limits nothing.


def discs(f, k, v, levels):
    """Centres, and radii as their kept and scaled parts, for S, T, isolation and bands."""
    rows = [(np.ones(len(f)), np.full(len(f), Ms), np.zeros(len(f)))]
    limit = np.where(f >= roll["hz"], (roll["hz"] / f) ** roll["order"], NONE)
    rows.append((np.zeros(len(f)), limit, np.zeros(len(f))))
    g, m = (np.array(x) for x in zip(*(motions(x, k, v) for x in f)))
    # One combination of the outputs, of size 1: that which the mode moves most.
    size = np.linalg.norm(m, axis=1)
    centre = np.sum(m.conj() * g, 1) / size / size
    # The loop changes it by S, but for what couples the sensors to the lens: some per cent.
    inside = (f >= isolated[0]) & (f <= isolated[1])
    still = np.sqrt(0.5) * abs(whole(0.05, k, v))
    here = np.array([abs(whole(x, k, v)) for x in f])
    rows.append((np.ones(len(f)), np.where(inside, still / here, NONE), np.zeros(len(f))))
    for band, level in zip(reached, levels):
        inside = (f >= band["low_hz"]) & (f <= band["high_hz"]) & (level > 0)
        rows.append((np.where(inside, centre, 0), np.where(inside, 0, NONE),
                     np.where(inside, level / size, 0)))
    return rows


def level_of(function, f, w, rows):
    """The level, dB, at which the sum of the least Re(phi·t) changes its sign."""
    phi = psi(function, np.exp(2j * np.pi * f * T)) @ np.array(function["coefficients"]) * w

    def total(db):
        factor = 10 ** (db / 20)
        return corners(phi, ([c for c, *_ in rows], [a + factor * b for _, a, b in rows])).sum()

    low, high = -150.0, 50.0
    while high - low > 1e-3:
        middle = (low + high) / 2
        low, high = (middle, high) if total(middle) > 0 else (low, middle)
    # At some samples by another way.
    factor = 10 ** (low / 20)
    for i in range(0, len(f), len(f) // 12):
        here = [(c[i], a[i] + factor * b[i]) for c, a, b in rows if a[i] < NONE]
        own = corners(phi[i:i + 1], ([np.array([c]) for c, _ in here],
                                     [np.array([r]) for _, r in here]))[0]
        split = lowest(phi[i], here)
        assert split <= own + 1e-6 * abs(phi[i]), (f[i], split, own)
        assert split > own - 0.02 * abs(phi[i]), (f[i], split, own)
    return low


def best_of(function, f, w, rows):
    """The highest level that any combination of the terms proves, by ECOS, dB."""
    basis = psi(function, np.exp(2j * np.pi * f * T))
    stacked = np.vstack([basis.real, basis.imag]) * np.sqrt(np.tile(w, 2))[:, None]
    q, _ = np.linalg.qr(stacked)
    basis = (q[: len(f)] + 1j * q[len(f):]) * np.sqrt(w)[:, None]
    count = basis.shape[1]
    entries, right, cost, scaled, cones = [], [], [0.0] * count, [], []
    equations = [[], []]
    for i in range(len(f)):
        here = [(c[i], a[i], b[i]) for c, a, b in rows if a[i] < NONE]
        at = [len(cost) + 3 * j for j in range(len(here))]
        for (c, a, b), x in zip(here, at):
            cost += [a, -np.real(c), np.imag(c)]
            scaled += [(x, b)] if b else []
            cones.append(x)
        for part, row in enumerate(equations):
            value = basis[i].real if part == 0 else basis[i].imag
            row.append((value, [x + 1 + part for x in at]))
    size = len(cost)
    rows_, columns, values, b = [], [], [], []
    for row in equations:
        for value, at in row:
            r = len(b)
            rows_ += [r] * (count + len(at))
            columns += list(range(count)) + at
            values += list(-value) + [1.0] * len(at)
            b.append(0.0)
    rows_ += [len(b)] * len(scaled)
    columns += [x for x, _ in scaled]
    values += [y for _, y in scaled]
    b.append(1.0)
    equal = sparse.csc_matrix((values, (rows_, columns)), (len(b), size))
    index = np.array([[x, x + 1, x + 2] for x in cones]).ravel()
    cone = sparse.csc_matrix((-np.ones(len(index)), (np.arange(len(index)), index)),
                             (len(index), size))
    found = ecos.solve(np.array(cost), cone, np.zeros(len(index)),
                       {"l": 0, "q": [3] * len(cones)}, equal, np.array(b), verbose=False)
    return 20 * np.log10(-found["info"]["pcost"]), found["info"]["infostring"]


worst = 0.0
for kind in [*range(len(reached)), "together"]:
    together = kind == "together"
    modes = bound["design"]["together"] if together else bound["design"]["bands"][kind]
    levels = ([10 ** (b["sampled_db"] / 20) for b in reached] if together
              else [1.0 if i == kind else 0.0 for i in range(len(reached))])
    for mode in modes:
        certificate = mode["found"]["modal"]
        if certificate is None or certificate == mode["found"]["any"]:
            continue
        k, function = mode["mode"] - 1, certificate["function"]
        # The rigid motion of the floor along the mode, by the sensors at low frequency.
        low = np.linalg.inv((to_modes @ plant(0.05)[0][outputs:, :6]).real)
        v = low[:, k] / np.linalg.norm(low[:, k])
        edges = sorted({1e-3, 0.5 / T, *isolated, roll["hz"],
                        *(b[x] for b in reached for x in ("low_hz", "high_hz"))})
        poles = [x for x in np.linalg.eigvals(A) if x.imag > 1]
        sharp = [(abs(x) / 2 / np.pi, max(-x.real, 1e-5 * abs(x)) / 2 / np.pi) for x in poles]
        for term in function["terms"]:
            d0, d1, _ = term["denominator"]
            if d1 and d1 * d1 < 4 * d0:
                sharp.append((np.sqrt(d0) / 2 / np.pi / T, d1 / 4 / np.pi / T))
        f, w = grid(edges, sharp, 200)
        again = level_of(function, f, w, discs(f, k, v, levels))
        f, w = grid(edges, sharp, 25)
        best, status = best_of(function, f, w, discs(f, k, v, levels))
        name = "all bands" if together else reached[kind]["name"]
        print(f"mode {mode['mode']}, {name}: host-gen {certificate['db']:.3f} dB, "
              f"again {again:.3f} dB, ECOS {best:.3f} dB ({status})")
        worst = max(worst, abs(again - certificate["db"]))
print(f"largest difference {worst:.3f} dB")
# Of the isolation some per cent are left out here.
assert worst < 0.1


def moved(f, file):
    """A, M and R: the motion of the outputs is A - M T R, with T at the forces along the modes."""
    G, P, hold = plant(f)
    board, low_high = file["board"], file["simulation"]["floor_band"]
    base = np.array([x["direction"] for x in file["floor"]["inputs"].values()])
    base = base * file["simulation"]["floor_rms"] / np.sqrt(low_high[1] - low_high[0])
    adc, dac, own = (board[x] for x in ("adc", "dac", "accelerometer"))
    rounding = lambda span, bits: (span / 2 ** bits) ** 2 / 12
    noise = own["noise_density"] ** 2 + (adc["noise"] ** 2 + rounding(2 * adc["range"], adc["bits"])) * (
        2 * T) / own["sensitivity"] ** 2
    force = dac["noise"] ** 2 + rounding(dac["range"][1] - dac["range"][0], dac["bits"])
    force = np.sqrt(force * 2 * T) * board["actuator"]["gain"]
    A = [G[:outputs, :6] @ base, G[:outputs, 6:] * hold * force, np.zeros((outputs, 6))]
    sensed = [G[outputs:, :6] @ base, P * force, np.eye(6) * np.sqrt(noise)]
    R = np.linalg.solve(to_modes @ P @ to_legs, to_modes @ np.hstack(sensed))
    return np.hstack(A), G[:outputs, 6:] @ to_legs * hold, R


def ball(f):
    """c and r of a ball that has all T within both limits."""
    t = np.where(f >= roll["hz"], (roll["hz"] / f) ** roll["order"], np.inf) ** 2
    with np.errstate(invalid="ignore"):
        c = np.where(np.isinf(t), 1.0, np.clip((1 + t - Ms**2) / 2, 0, 1))
        r = np.where(np.isinf(t), Ms**2, np.where(c < 1, (1 - c) * t, 0) + c * Ms**2 - c * (1 - c))
    return c, np.sqrt(r)


def square_of(found, file, f, w):
    """The mean square that the certificate proves on a grid, from below and from above."""
    w = w / T / 2  # Hz
    z = np.exp(2j * np.pi * f * T)
    entries = [(e["to"] - 1, e["from"] - 1) for e in found["certificate"]]
    phi = np.array([psi(e["function"], z) @ np.array(e["function"]["coefficients"])
                    for e in found["certificate"]]).T
    i, j = np.array(entries).T
    c, r = ball(f)
    full = lambda x: (lambda m: (m.__setitem__((slice(None), i, j), x), m)[1])(
        np.zeros((len(x), 6, 6), complex))
    nuclear = lambda y: np.linalg.svd(full(y), compute_uv=False).sum(1)
    same = (i == j) * 1.0
    floor = lambda y, c, r: c * (y * same).real.sum(1) - r * nuclear(y)
    low, high = file["simulation"]["floor_band"]
    inside = (f > low) & (f < high)
    outside = w[~inside] @ floor(phi[~inside], c[~inside], r[~inside])
    f, w, phi, c, r = (x[inside] for x in (f, w, phi, c, r))
    A, M, R = (np.array(x) for x in zip(*(moved(x, file) for x in f)))
    H = (M.conj().transpose(0, 2, 1) @ M)[:, i][:, :, i] * (R @ R.conj().transpose(0, 2, 1))[:, j][
        :, :, j].transpose(0, 2, 1)
    l = -2 * (R @ A.conj().transpose(0, 2, 1) @ M)[:, j, i]
    constant = (abs(A) ** 2).sum((1, 2))
    e, X = np.linalg.eigh(H)
    e, p = np.maximum(e, 0), np.einsum("fkm,fk->fm", X, l + phi)
    squared = lambda t: np.einsum("fk,fkl,fl->f", t.conj(), H, t).real
    rho = np.sqrt(e.max(1) * np.maximum(e.mean(1), 1e-12 * e.max(1)))
    best, least = np.full(len(f), -np.inf), np.full(len(f), np.inf)
    Z = np.tile(same, (len(f), 1)) * c[:, None] + 0j
    U = np.zeros_like(Z)
    for n in range(3000):
        # t: least e|t|^2 + Re(p t) + rho/2 |t - Z + U|^2
        v = np.einsum("fkm,fk->fm", X.conj(), Z - U)
        t = np.einsum("fkm,fm->fk", X, (rho[:, None] * v - p.conj()) / (2 * e + rho[:, None]))
        a, s, b = np.linalg.svd(full(t + U - c[:, None] * same))
        new = ((a * np.minimum(s, r[:, None])[:, None, :]) @ b)[:, i, j] + c[:, None] * same
        change, Z = rho * np.linalg.norm(new - Z, axis=1), new
        U = U + t - Z
        if n % 25 == 24:
            least = np.minimum(least, constant + squared(Z) + ((l + phi) * Z).sum(1).real)
            for x in (Z, t):
                slope = phi + l + 2 * np.einsum("fkl,fl->fk", H, x).conj()
                best = np.maximum(best, constant - squared(x) + floor(slope, c, r))
            apart = rho * np.linalg.norm(t - Z, axis=1)
            factor = np.where(apart > 5 * change, 2.0, np.where(change > 5 * apart, 0.5, 1.0))
            rho, U = rho * factor, U / factor[:, None]
            if w @ (least - best) < 1e-3 * abs(outside + w @ best):
                break
    return outside + w @ best, outside + w @ least


if bound["rms"]:
    file = tomllib.loads((folder / "machine.toml").read_text())
    poles = np.linalg.eigvals(A)
    # Transmission zeros from legs to sensors.
    zeros = eigvals(np.block([[A, B[:, 6:]], [C[outputs:], D[outputs:, 6:]]]),
                    np.diag([1.0] * n + [0.0] * 6))
    peaks = [x for x in (*poles, *zeros[np.isfinite(zeros)]) if 1 < x.imag < np.pi / T]
    for kind, found in bound["rms"]["found"].items():
        sharp = [(abs(x) / 2 / np.pi, max(abs(x.real), 1e-5 * abs(x)) / 2 / np.pi) for x in peaks]
        for term in found["certificate"][0]["function"]["terms"]:
            d0, d1, _ = term["denominator"]
            if d1 and d1 * d1 < 4 * d0:
                sharp.append((np.sqrt(d0) / 2 / np.pi / T, d1 / 4 / np.pi / T))
        edges = sorted({1e-3, 0.5 / T, roll["hz"], *file["simulation"]["floor_band"]})
        below, above = square_of(found, file, *grid(edges, sharp, 60))
        below, above = np.sqrt(below), np.sqrt(above)
        print(f"rms, {kind}: host-gen {found['rms']:.4e}, again {below:.4e} to {above:.4e}, "
              f"reached {bound['rms']['reached']:.4e}")
        assert 0.995 * found["rms"] < above and below < 1.005 * found["rms"]
        assert above < 1.01 * below
