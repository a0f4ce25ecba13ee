/* @ABOUT@
 *
 *   x(k) = N(u(k))
 *   y(k) = -a_1 y(k-1) - .. - a_na y(k-na) + b_0 x(k-delay) + .. + b_nb x(k-delay-nb) + drift
 *
 * u command, y output@UNIT@, one row each @PERIOD@ s. N holds for commands from @LOW@ to @HIGH@.
 * Needs C99 and no library.
 *
 *   @NAME@_state state;
 *   @NAME@_reset(&state);
 *   for each row k:
 *       next = @NAME@_step(&state, y, u);                 y(k+1) from the rows up to k
 *       later = @NAME@_ahead(&state, u_after, steps);     y(k+steps) with the commands u(k+1) .. u(k+steps-1)
 */
#ifndef @UPPER@_H
#define @UPPER@_H

#include <math.h>
#include <stddef.h>
#include <string.h>

#define @UPPER@_PERIOD @PERIOD@
#define @UPPER@_OUTPUTS @NA@
#define @UPPER@_LAGS @LAGS@
#define @UPPER@_ORDER @ORDER@
#define @UPPER@_DELAY @DELAY@
#define @UPPER@_COMMANDS (@UPPER@_DELAY + @UPPER@_LAGS - 1)

/* The past of one axis. */
typedef struct {
    double y[@UPPER@_OUTPUTS];  /* outputs, newest first */
    double x[@UPPER@_COMMANDS]; /* values of N, newest first */
    size_t rows;                /* rows since the last reset */
} @NAME@_state;

/* N(u). */
static inline double @NAME@_nonlinearity(double u)
{
    static const double f[@UPPER@_ORDER] = {@F@};
    static const double g[@UPPER@_ORDER] = {@G@};
    const double low = @DEAD_LOW@, high = @DEAD_HIGH@;
    const double v = u > high ? u - high : u < -low ? u + low : 0.0 * u;
    const double *c = v >= 0.0 ? f : g;
    double sum = 0.0;
    int i;
@SUM@
}

/* Forgets all rows: to be called first, and after a gap. */
static inline void @NAME@_reset(@NAME@_state *state)
{
    memset(state, 0, sizeof *state);
}

/* Whether there are rows enough for a prediction. */
static inline int @NAME@_is_ready(const @NAME@_state *state)
{
    return state->rows >= @UPPER@_OUTPUTS && state->rows >= @UPPER@_COMMANDS;
}

/* The prediction from the rows in the state; a row has the output y(k) and the command u(k) that acts from then on. */
static inline double @NAME@_next(const @NAME@_state *state)
{
    static const double a[@UPPER@_OUTPUTS] = {@A@};
    static const double b[@UPPER@_LAGS] = {@B@};
    double past = 0.0, driven = 0.0;
    int i;
    if (!@NAME@_is_ready(state))
        return NAN;
    for (i = 0; i < @UPPER@_OUTPUTS; i++)
        past += a[i] * state->y[i];
    for (i = 0; i < @UPPER@_LAGS; i++)
        driven += b[i] * state->x[@UPPER@_DELAY - 1 + i];
    return driven - past + @DRIFT@;
}

/* Takes in y(k) and u(k). Returns the prediction of y(k+1), or NAN as long as there are not rows enough. */
static inline double @NAME@_step(@NAME@_state *state, double y, double u)
{
    memmove(state->y + 1, state->y, sizeof state->y - sizeof state->y[0]);
    memmove(state->x + 1, state->x, sizeof state->x - sizeof state->x[0]);
    state->y[0] = y;
    state->x[0] = @NAME@_nonlinearity(u);
    state->rows++;
    return @NAME@_next(state);
}

/* The prediction of y(k+steps), steps at least 1, with the commands u[0] = u(k+1) .. u[steps-2] = u(k+steps-1). The
 * state stays as it is. */
static inline double @NAME@_ahead(const @NAME@_state *state, const double *u, size_t steps)
{
    @NAME@_state own = *state;
    double y = @NAME@_next(&own);
    size_t i;
    for (i = 0; i + 1 < steps; i++)
        y = @NAME@_step(&own, y, u[i]);
    return y;
}

#endif
