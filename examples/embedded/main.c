/* The oven's loop on a microcontroller: every 0.5 s a reading, bounds of the load, and a decision.
 *
 * Here the oven is simulated and the output is a terminal; on a chip `reading` asks the converter and
 * `heat` sets a pin. Temperatures are above that of the room.
 */
#include "oven.h"

#include <stdio.h>

#define ROWS 16u

typedef struct {
    float chamber;
    float load;
} oven;

/* The oven after 0.5 s, in short steps. */
static void simulate(oven *it, float power)
{
    for (int k = 0; k < 5000; ++k) {
        const float chamber = it->chamber;
        it->chamber += 1e-4f * (-0.30f * chamber + 0.10f * it->load + 0.8f * power + 0.1f);
        it->load += 1e-4f * (0.05f * chamber - 0.05f * it->load - 0.01f);
    }
}

static bool reading(const oven *it, unsigned tick, float *y)
{
    *y = it->chamber + ((tick % 2u == 0u) ? 0.3f : -0.3f); /* noise */
    return tick != 5u;                                     /* a broken wire, once */
}

static void heat(float power)
{
    printf("  heater %.0f\n", (double)power);
}

int main(void)
{
    const float lower[OVEN_STATES] = { -1.0f, -1.0f };
    const float upper[OVEN_STATES] = { 1.0f, 1.0f };
    oven_state state;
    oven_sample sample;
    oven_estimate estimate;
    oven truth = { 0.2f, -0.1f };
    float power = 0.0f;

    oven_init(&state, lower, upper);
    for (unsigned tick = 0u; tick < ROWS; ++tick) {
        if (tick > 0u) {
            simulate(&truth, power);
        }
        sample.h = (tick == 0u) ? 0.0f : 0.5f;
        sample.has_y = reading(&truth, tick, &sample.y[0]);
        /* off as soon as the load may be above 1.5 K, whatever the noise and the room did */
        power = (tick > 0u && estimate.upper[1] > 1.5f) ? 0.0f : 10.0f;
        sample.u[0] = power;
        oven_step(&state, &sample, &estimate);
        printf("%4.1f s  load %6.2f in %6.2f .. %6.2f K  status %u\n", 0.5 * tick, (double)truth.load,
               (double)estimate.lower[1], (double)estimate.upper[1], (unsigned)estimate.status);
        if (estimate.status >= (uint32_t)OVEN_OUTSIDE) {
            heat(0.0f); /* no bounds: the safe side */
            return 1;
        }
        heat(power);
    }
    return 0;
}
