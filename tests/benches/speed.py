"""The work of speed.rs in NumPy, on the matrices that `host-gen plant
--matrix-market FOLDER` writes. Usage: speed.py FOLDER"""

import sys
import time

import numpy as np
from scipy.io import mmread
from scipy.linalg import expm

folder = sys.argv[1]
a, b, c, d = (np.asarray(mmread(f"{folder}/acceleration-{name}.mtx")) for name in "ABCD")


def best(work, times):
    taken = []
    for _ in range(times):
        start = time.perf_counter()
        work()
        taken.append(time.perf_counter() - start)
    return 1e3 * min(taken)


def sigma():
    s = 2j * np.pi * np.geomspace(0.1, 316.0, 2000)[:, None, None]
    g = c @ np.linalg.solve(s * np.eye(len(a)) - a, np.broadcast_to(b, (2000, *b.shape))) + d
    return np.linalg.svd(g, compute_uv=False)[:, 0].max()


def march():
    """Plant and a PI law of the same size, without noise and converters."""
    period = 5e-5
    n = len(a)
    whole = expm(np.block([[a, b], [np.zeros((12, n + 12))]]) * period)
    phi, gamma = whole[:n, :n], whole[:n, n:]
    floor = np.random.default_rng(1).standard_normal((200_000, 6)) * 1e-3
    x, force, integral = np.zeros(n), np.zeros(6), np.zeros(6)
    gain = np.eye(6)
    for w in floor:
        u = np.concatenate((w, force))
        y = c @ x + d @ u
        integral = integral + 1e-6 * (gain @ y[6:])
        force = -(gain @ y[6:] + integral)
        x = phi @ x + gamma @ u
    return x


print(f"NumPy: sigma of G, 12x12, 2000 frequencies  {best(sigma, 5):8.1f} ms")
print(f"NumPy: closed loop, 200,000 steps           {best(march, 1):8.1f} ms")
