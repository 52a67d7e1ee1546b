/* SPDX-License-Identifier: MIT OR Apache-2.0
 *
 * What the C peers share: the robots and their coefficients, the clock and the
 * line of JSON. All of it is double precision and outside the timed part.
 */
#ifndef FLEET_COMMON_H
#define FLEET_COMMON_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

/* The step of the integration in seconds. */
#define STEP 1e-3

/* The first robots of every fleet, over which the second check takes its mean,
 * so that a wrong lane cannot hide behind a right robot 0. */
#define CHECKED 1024

/* The equations of one robot, its constants folded:
 *   dv   = pull * (i_l + i_r) + swing * w * w
 *   dw   = turn * (i_r - i_l) - drag * v * w
 *   di_l = u_l - decay * i_l - back_v * v + back_w * w
 *   di_r = u_r - decay * i_r - back_v * v - back_w * w
 * where u_l and u_r are voltages over the inductance. */
typedef struct {
    double pull, swing, turn, drag, decay, back_v, back_w, u_l, u_r;
} Coefficients;

/* Robot number k. Each robot differs in mass, inertia, resistance and torque. */
static inline Coefficients robot(long k)
{
    const double radius = 0.05, half_track = 0.15, ahead = 0.05;
    const double emf = 1.0, inductance = 1.2e-3, left = 6.0, right = 5.0;
    const double vary_mass = 1 + 0.02 * sin((double)k);
    const double mass = 9.6 * vary_mass, mass_eff = 10.4 * vary_mass;
    const double inertia_eff = 0.16 * (1 + 0.02 * sin(k + 1.0));
    const double resistance = 1.2 * (1 + 0.02 * sin(k + 2.0));
    const double torque = 0.8 * (1 + 0.02 * sin(k + 3.0));
    return (Coefficients){
        .pull = torque / (radius * mass_eff),
        .swing = mass * ahead / mass_eff,
        .turn = half_track * torque / (radius * inertia_eff),
        .drag = mass * ahead / inertia_eff,
        .decay = resistance / inductance,
        .back_v = emf / (radius * inductance),
        .back_w = emf * half_track / (radius * inductance),
        .u_l = left / inductance,
        .u_r = right / inductance,
    };
}

static inline double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* The size of the work: robots, steps, rounds from the command line. */
typedef struct {
    long robots, steps, rounds;
} Work;

static inline Work work_of(int argc, char **argv)
{
    Work work = { 8192, 1000, 20 };
    if (argc > 1) work.robots = atol(argv[1]);
    if (argc > 2) work.steps = atol(argv[2]);
    if (argc > 3) work.rounds = atol(argv[3]);
    if (work.robots < CHECKED || work.steps < 1 || work.rounds < 1) {
        fprintf(stderr, "usage: %s [robots >= %d] [steps] [rounds]\n", argv[0], CHECKED);
        exit(2);
    }
    return work;
}

/* The best round is reported, since what slows a round down on a shared machine is not
 * the peer's fault; the median beside it tells how quiet the machine was. Hence many
 * short rounds: one of them is likely to be left alone. */
static inline int ascending(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static inline void report(const char *peer, Work work, double *seconds, double check, double mean)
{
    qsort(seconds, (size_t)work.rounds, sizeof *seconds, ascending);
    const double million = 1e-6 * (double)work.robots * (double)work.steps;
    printf("{\"peer\": \"%s\", \"robots\": %ld, \"steps\": %ld, \"Msteps_per_s\": %.2f, "
           "\"median\": %.2f, \"check\": %.15g, \"check_mean\": %.15g}\n",
           peer, work.robots, work.steps, million / seconds[0],
           million / seconds[work.rounds / 2], check, mean);
    fflush(stdout);
}

#endif
