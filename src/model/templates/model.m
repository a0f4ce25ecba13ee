function model = @NAME@()
%@UPPER@  @ABOUT@
%
%   model = @NAME@() has the fields
%
%     A, B, C, E   s(k+1) = A s(k) + B x(k) + E,   y(k) = C s(k),   x(k) = N(u(k))
%     N            the nonlinearity, element by element
%     T            the period, s
%     state        the state from the last rows: s(k) = model.state(y, u), y = [y(k), y(k-1), ..] and
%                  u = [u(k-1), u(k-2), ..], size(A, 1) outputs and one command less
%
%   u command, y output@UNIT@. N holds for commands from @LOW@ to @HIGH@.
%   With the Control System Toolbox: ss(model.A, model.B, model.C, 0, model.T) is the part behind N.

a = [@A@];
b = [@B@];
delay = @DELAY@;
n = max(numel(a), delay + numel(b) - 1);
past = zeros(n, 1);
past(1:numel(a)) = -a;
driven = zeros(n, 1);
driven(delay:delay + numel(b) - 1) = b;

model.A = [past, [eye(n - 1); zeros(1, n - 1)]];
model.B = driven;
model.C = [1, zeros(1, n - 1)];
model.E = [@DRIFT@; zeros(n - 1, 1)];
model.N = @nonlinearity;
model.T = @PERIOD@;
model.state = @(y, u) state(past, driven, y(:), nonlinearity(u(:)));
end

function s = state(past, driven, y, x)
n = numel(past);
s = zeros(n, 1);
s(1) = y(1);
for i = 2:n
    s(i) = past(i:n)' * y(2:n - i + 2) + driven(i:n)' * x(1:n - i + 1);
end
end

function x = nonlinearity(u)
f = [@F@];
g = [@G@];
@KNOTS@v = zeros(size(u));
v(u > @DEAD_HIGH@) = u(u > @DEAD_HIGH@) - @DEAD_HIGH@;
v(u < -@DEAD_LOW@) = u(u < -@DEAD_LOW@) + @DEAD_LOW@;
x = zeros(size(u));
for i = 1:numel(f)
    c = f(i) * (v >= 0) + g(i) * (v < 0);
    x = x + c .* @FEATURE@;
end
end
