"""@ABOUT@

    x(k) = N(u(k))
    y(k) = -a_1 y(k-1) - .. - a_na y(k-na) + b_0 x(k-delay) + .. + b_nb x(k-delay-nb) + drift

u command, y output@UNIT@, one row each @PERIOD@ s. N holds for commands from @LOW@ to @HIGH@.
Needs Python 3 and no package.

    model = Model()
    for y, u in rows:
        following = model.step(y, u)          # y(k+1) from the rows up to k
        later = model.ahead(commands_after)   # y(k+n) with the n - 1 commands u(k+1) .. u(k+n-1)
"""

from collections import deque

PERIOD = @PERIOD@
DELAY = @DELAY@
A = [@A@]
B = [@B@]
F = [@F@]
G = [@G@]
DRIFT = @DRIFT@
DEAD_BAND = (@DEAD_LOW@, @DEAD_HIGH@)
COMMANDS = (@LOW@, @HIGH@)


def nonlinearity(u):
    """N(u)."""
    low, high = DEAD_BAND
    v = u - high if u > high else u + low if u < -low else 0.0 * u
    coefficients = F if v >= 0.0 else G
    total = 0.0
@SUM@


class Model:
    """The model with the past of one axis."""

    def __init__(self):
        self.reset()

    def reset(self):
        """Forgets all rows: to be called after a gap."""
        self._y = deque(maxlen=len(A))
        self._x = deque(maxlen=DELAY + len(B) - 1)

    def step(self, y, u):
        """Takes in y(k) and u(k). Returns the prediction of y(k+1), or NaN as long as there are not rows enough."""
        self._y.appendleft(y)
        self._x.appendleft(nonlinearity(u))
        return self._next()

    def ahead(self, commands):
        """The prediction of y(k+n) with the n - 1 commands u(k+1) .. u(k+n-1). The model stays as it is."""
        own = Model()
        own._y, own._x = self._y.copy(), self._x.copy()
        y = own._next()
        for u in commands:
            y = own.step(y, u)
        return y

    def _next(self):
        if len(self._y) < self._y.maxlen or len(self._x) < self._x.maxlen:
            return float("nan")
        past = driven = 0.0
        for a, y in zip(A, self._y):
            past += a * y
        for j, b in enumerate(B):
            driven += b * self._x[DELAY - 1 + j]
        return driven - past + DRIFT
