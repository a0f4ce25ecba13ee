"""The estimator `paper` against the paper's equations, written here a second time with 50 digits.

y(k) = -a_1 y(k-1) .. -a_na y(k-na) + b_0 x(k-nk) .. + b_nb x(k-nk-nb), x = f_1 u .. + f_r u^r, g in its place for u < 0
"""

import csv
import json
import math
import random
import tempfile
import unittest
from decimal import Decimal, localcontext
from pathlib import Path

from support import command

DIGITS = 50
TOLERANCE = 1e-9
TABLE_1 = """VS VS MS S  B  MB MB
             VS MS S  B  MB VB B
             MS S  B  MB MB VB S
             S  S  VB VB VB S  MS
             S  B  MB VB B  S  MS
             S  MB MB MB S  MS VS
             MB MB VB S  S  VS VS"""
FACTORS = {"VS": 0.75, "MS": 0.80, "S": 0.85, "B": 0.90, "MB": 0.95, "VB": 1.0}
RULES = [[FACTORS[name] for name in row.split()] for row in TABLE_1.splitlines()]
# The universes [-4, 4] and [-2, 2] in millimetres; the records are in metres.
UNIVERSES = 4e-3, 2e-3
ROWS, TRAINING = 900, 500


def plant(seed):
    """Commands and positions (m) of a plant with noise whose gain rises by half after the training."""
    draw = random.Random(seed)
    a, b = (-1.5, 0.7, -0.1), (0.02, 0.012)
    f, g = (1.0, 0.4, -0.2), (0.8, -0.3, 0.15)
    commands = [draw.uniform(-1, 1) for _ in range(ROWS)]
    x = [sum(c * u ** i for i, c in enumerate(f if u >= 0 else g, 1)) for u in commands]
    positions = []
    for k in range(ROWS):
        gain = 1.5 if k > TRAINING + 100 else 1.0
        past = sum(c * positions[k - i] for i, c in enumerate(a, 1) if k >= i)
        driven = sum(c * x[k - j] for j, c in enumerate(b, 1) if k >= j)
        positions.append(gain * driven - past + draw.gauss(0, 5e-4))
    return commands, positions


def membership(relative):
    """Fig. 3: NB .. PB at -3 .. 3; curves near zero, triangles outside."""
    at = 3 * min(max(relative, -1.0), 1.0)
    distances = [abs(at - term) for term in range(-3, 4)]
    curve = [(1 + math.cos(math.pi * d)) / 2 if d < 1 else 0.0 for d in distances]
    triangle = [max(0.0, 1 - d) for d in distances]
    return triangle[:2] + curve[2:5] + triangle[5:]


def forgetting_factor(error, change):
    """Table 1 and (21)."""
    columns, rows = membership(error / UNIVERSES[0]), membership(change / UNIVERSES[1])
    weights = [[min(row, column) for column in columns] for row in rows]
    return (sum(w * p for ws, ps in zip(weights, RULES) for w, p in zip(ws, ps)) / sum(map(sum, weights)))


def dot(one, two):
    return sum((p * q for p, q in zip(one, two)), Decimal(0))


def inverse(matrix):
    """Gauss and Jordan, with pivots."""
    n = len(matrix)
    rows = [list(row) + [Decimal(i == j) for j in range(n)] for i, row in enumerate(matrix)]
    for i in range(n):
        pivot = max(range(i, n), key=lambda row: abs(rows[row][i]))
        rows[i], rows[pivot] = rows[pivot], rows[i]
        rows[i] = [value / rows[i][i] for value in rows[i]]
        for j in range(n):
            if j != i:
                rows[j] = [value - rows[j][i] * own for value, own in zip(rows[j], rows[i])]
    return [row[n:] for row in rows]


def information(rows):
    """Phi' Phi."""
    columns = list(zip(*rows))
    return [[dot(one, two) for two in columns] for one in columns]


class Paper:
    """Steps 1 to 6 on one record."""

    def __init__(self, commands, positions, na, nb, nk, r):
        self.u, self.y = [[Decimal(value) for value in values] for values in (commands, positions)]
        self.na, self.nb, self.nk, self.r = na, nb, nk, r
        self.offline()
        self.online()

    def outputs(self, k):
        return [-self.y[k - i] for i in range(1, self.na + 1)]

    def delayed(self, k, of):
        return [of(self.u[k - self.nk - j]) for j in range(self.nb + 1)]

    def offline(self):
        """Step 3: (14), (15), (17)."""
        powers = [(sign, i) for sign in (True, False) for i in range(1, self.r + 1)]
        self.rows = range(max(self.na, self.nk + self.nb), TRAINING)
        phi = [self.outputs(k) + [value for sign, i in powers
                                  for value in self.delayed(k, lambda u: u ** i if (u >= 0) == sign else Decimal(0))]
               for k in self.rows]
        right = [dot(column, [self.y[k] for k in self.rows]) for column in zip(*phi)]
        theta = [dot(row, right) for row in inverse(information(phi))]
        lags = self.nb + 1
        products = [theta[self.na + i * lags:self.na + (i + 1) * lags] for i in range(2 * self.r)]
        quotients = [dot(products[0], row) / dot(products[0], products[0]) for row in products]
        self.f, self.g = quotients[:self.r], quotients[self.r:]
        self.theta = self.held = theta[:self.na] + products[0]

    def phi(self, k):
        """The linear form: x = N(u) is known, (11)."""
        valve = lambda u: dot(self.f if u >= 0 else self.g, [u ** i for i in range(1, self.r + 1)])
        return self.outputs(k) + self.delayed(k, valve)

    def online(self):
        """Steps 4 to 6: (21), (18), (19), (20)."""
        p = inverse(information([self.phi(k) for k in self.rows]))
        self.factors, last = [], 0.0
        for k in range(TRAINING, ROWS):
            phi = self.phi(k)
            error = self.y[k] - dot(phi, self.theta)
            factor = Decimal(forgetting_factor(float(error), float(error) - last))
            last = float(error)
            p_phi = [dot(row, phi) for row in p]
            gain = [value / (factor + dot(phi, p_phi)) for value in p_phi]
            self.theta = [value + own * error for value, own in zip(self.theta, gain)]
            phi_p = [dot(phi, column) for column in zip(*p)]
            p = [[(value - own * below) / factor for value, below in zip(row, phi_p)] for row, own in zip(p, gain)]
            self.factors.append(float(factor))


class PaperTest(unittest.TestCase):
    def compare(self, seed, na, nb, nk, r):
        commands, positions = plant(seed)
        with localcontext() as context:
            context.prec = DIGITS
            expected = Paper(commands, positions, na, nb, nk, r)
        with tempfile.TemporaryDirectory() as folder:
            record = Path(folder) / "record.csv"
            with open(record, "w", newline="") as file:
                csv.writer(file).writerows([("u", "y"), *zip(commands, positions)])
            options = f"--period 0.01 --train {TRAINING} --na {na} --nb {nb} --nk {nk} --order {r} --json -"
            answer = command("identify", record, "--estimator", "paper", *options.split())
        self.assertEqual(answer.returncode, 0, answer.stderr)
        found = json.loads(answer.stdout)
        self.assertEqual((found["outliers"], found["faults"], found["split"]), (0, [], "paper"))
        for model, theta in (("classical", expected.held), ("adaptive", expected.theta)):
            coefficients = found[model]["coefficients"]
            lists = {"a": theta[:na], "b": theta[na:], "f": expected.f, "g": expected.g}
            for name, values in lists.items():
                self.assertEqual(len(coefficients[name]), len(values))
                for one, two in zip(coefficients[name], values):
                    self.assertAlmostEqual(one, float(two), delta=TOLERANCE, msg=f"{model} {name}, seed {seed}")
        factor = found["adaptive"]["forgetting_factor"]
        self.assertAlmostEqual(factor["mean"], sum(expected.factors) / len(expected.factors), delta=TOLERANCE)
        self.assertAlmostEqual(factor["min"], min(expected.factors), delta=TOLERANCE)
        # The errors of this record reach all over the universes.
        self.assertLess(factor["min"], 0.85)

    def test_it_is_the_paper_with_the_papers_orders(self):
        for seed in (1, 2, 3):
            self.compare(seed, na=3, nb=1, nk=1, r=3)

    def test_it_is_the_paper_with_other_orders(self):
        self.compare(4, na=2, nb=2, nk=1, r=2)
        self.compare(5, na=1, nb=0, nk=2, r=3)
        self.compare(6, na=4, nb=1, nk=1, r=1)


if __name__ == "__main__":
    unittest.main()
