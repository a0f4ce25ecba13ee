#!/usr/bin/env python3
"""Time of one update of recursive least squares in Python, on the rows of benches/peers.rs.

Needs Python 3.9 or newer, numpy and padasip:

    pip install numpy==2.4.6 padasip==1.2.2
    python3 benches/peers.py

With the figures of the Rust benchmark it prints ratios to ours as well:

    cargo bench --bench peers -- --json "$PWD/peers.json"
    python3 benches/peers.py --ours peers.json

--quick for a short run, --json FILE for programs. One sample is the mean of 16 updates. Both contestants take turns.
"""

import argparse
import json
import math
import os
import sys
import time

try:
    import numpy
    from padasip.filters import FilterRLS
except ImportError as error:
    print(f"peers.py: no Python package {error.name}; pip install numpy padasip", file=sys.stderr)
    sys.exit(2)

LAMBDA = 0.995
BATCH = 16
OURS = "RecursiveLeastSquares"


def noise(i):
    x = math.sin(i * 12.9898) * 43758.5453
    return 2.0 * (x - math.floor(x)) - 1.0


def rows(n):
    """The rows of benches/data/mod.rs."""
    phi = numpy.array([[noise(k * n + j) for j in range(n)] for k in range(1024)])
    y = phi @ (1.0 / numpy.arange(1, n + 1)) + 0.01 * numpy.array([noise(k + 7) for k in range(1024)])
    return phi, [float(value) for value in y]


class Numpy:
    """Equations (18)-(20) in numpy, in place where possible.

    The matrix that is subtracted from P must be symmetric to the last bit. Every update divides the difference of P and
    its transpose by lambda, so that a small difference would outgrow P within a few thousand updates.
    """

    def __init__(self, n):
        self.w = numpy.zeros(n)
        self.p = numpy.eye(n) * 100.0
        self.outer = numpy.empty((n, n))

    def adapt(self, y, phi):
        gain = self.p @ phi
        beta = LAMBDA + phi @ gain
        self.w += gain * ((y - phi @ self.w) / beta)
        numpy.multiply.outer(gain, gain, out=self.outer)
        self.outer /= beta
        self.p -= self.outer
        self.p /= LAMBDA


def compare(n, samples):
    """Times of all contestants, ns per update, by name."""
    phi, y = rows(n)
    contestants = {"numpy": Numpy(n), "padasip FilterRLS": FilterRLS(n, mu=LAMBDA, eps=0.01)}
    times = {name: [] for name in contestants}
    for contestant in contestants.values():
        for k in range(1024):
            contestant.adapt(y[k], phi[k])
    for sample in range(samples):
        start = sample * BATCH % 1024
        batch = list(zip(y[start : start + BATCH], phi[start : start + BATCH]))
        for name, contestant in contestants.items():
            adapt = contestant.adapt
            begin = time.perf_counter_ns()
            for target, row in batch:
                adapt(target, row)
            times[name].append((time.perf_counter_ns() - begin) / BATCH)
    learned = [contestant.w for contestant in contestants.values()]
    assert numpy.allclose(*learned, atol=1e-6), "the coefficients differ"
    return times


def percentile(ordered, part):
    return ordered[max(math.ceil(len(ordered) * part), 1) - 1]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="takes few samples: shows that it works, not how fast")
    parser.add_argument("--ours", metavar="FILE", help="figures that benches/peers.rs wrote with --json")
    parser.add_argument("--json", metavar="FILE", help="writes the figures here as well")
    arguments = parser.parse_args()
    ours = {}
    if arguments.ours:
        try:
            with open(arguments.ours, encoding="utf-8") as file:
                ours = {each["n"]: each["p50_ns"] for each in json.load(file)["figures"] if each["name"] == OURS}
        except (OSError, ValueError, KeyError) as error:
            print(f"peers.py: {arguments.ours}: {error!r}", file=sys.stderr)
            sys.exit(2)
    load = [os.getloadavg()[0]]
    figures = []
    for n in (5, 15, 40):
        print(f"n = {n:<20} p50, ns       p99     p99.9       max    samples     / ours")
        for name, times in compare(n, 50 if arguments.quick else 4000).items():
            times.sort()
            p50, p99, p999 = (percentile(times, part) for part in (0.5, 0.99, 0.999))
            ratio = p50 / ours[n] if n in ours else None
            shown = "-" if ratio is None else f"{ratio:.1f}"
            print(f"{name:<23} {p50:>9.1f} {p99:>9.1f} {p999:>9.1f} {times[-1]:>9.1f} {len(times):>10} {shown:>10}")
            figures.append({
                "n": n, "name": name, "samples": len(times), "updates_per_sample": BATCH, "p50_ns": p50, "p99_ns": p99,
                "p99_9_ns": p999, "max_ns": times[-1], "to_ours": ratio,
            })
        print()
    load.append(os.getloadavg()[0])
    loads = f"load {load[0]:.2f} before, {load[1]:.2f} after"
    print(f"per update; one sample is the mean of {BATCH}; ratios of p50; {loads}")
    if 15 in ours:
        padasip = next(each for each in figures if each["n"] == 15 and each["name"].startswith("padasip"))
        print(f"at n = 15: padasip takes {padasip['to_ours']:.0f} x as long as ours (aim: at least 80)")
    if arguments.json:
        with open(arguments.json, "w", encoding="utf-8") as file:
            json.dump({"load": load, "figures": figures}, file, indent=2)


if __name__ == "__main__":
    main()
