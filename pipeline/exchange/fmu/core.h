/* A linear machine at a fixed step with held inputs:  x+ = A x + B u,  y = C x + D u.
   model.h holds the numbers: A as blocks of two states, then one dense block. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "model.h"

enum { TIME_REFERENCE = 0, FIRST_INPUT = 1, FIRST_OUTPUT = 1 + INPUTS, VARIABLES = 1 + INPUTS + OUTPUTS };
#define PAIRED (2 * PAIRS)
#define STATES (PAIRED + DENSE)
#define ROOM(count) ((count) > 0 ? (count) : 1) /* C knows no empty array */

typedef struct {
    double time;
    double states[ROOM(STATES)];
    double inputs[ROOM(INPUTS)];
} Motion;

typedef struct {
    Motion motion;
    void *environment;
    void *callback;
    char *name;
} Machine;

static Machine *create(const char *name, void *environment, void *callback) {
    Machine *machine = calloc(1, sizeof(Machine));
    if (!machine) return NULL;
    machine->name = malloc(strlen(name ? name : "") + 1);
    if (!machine->name) {
        free(machine);
        return NULL;
    }
    strcpy(machine->name, name ? name : "");
    machine->environment = environment;
    machine->callback = callback;
    return machine;
}

static void destroy(Machine *machine) {
    if (machine) free(machine->name);
    free(machine);
}

/* Number of whole steps in a communication step; -1 where it is no multiple of STEP. */
static long count_steps(double size) {
    double steps = size / STEP;
    long whole = lround(steps);
    return size >= 0.0 && fabs(steps - (double)whole) <= 1e-6 ? whole : -1;
}

static void advance(Motion *motion, long steps) {
    double *x = motion->states, drive[ROOM(STATES)], next[ROOM(DENSE)];
    for (int row = 0; row < STATES; row++) {
        drive[row] = 0.0;
        for (int input = 0; input < INPUTS; input++) drive[row] += B[row * INPUTS + input] * motion->inputs[input];
    }
    for (long step = 0; step < steps; step++) {
        for (int pair = 0; pair < PAIRS; pair++) {
            const double *block = BLOCKS + 4 * pair;
            double first = x[2 * pair], second = x[2 * pair + 1];
            x[2 * pair] = block[0] * first + block[1] * second + drive[2 * pair];
            x[2 * pair + 1] = block[2] * first + block[3] * second + drive[2 * pair + 1];
        }
        for (int row = 0; row < DENSE; row++) {
            next[row] = drive[PAIRED + row];
            for (int column = 0; column < DENSE; column++) next[row] += A[row * DENSE + column] * x[PAIRED + column];
        }
        memcpy(x + PAIRED, next, DENSE * sizeof(double));
    }
    motion->time += (double)steps * STEP;
}

static int get_value(const Motion *motion, unsigned reference, double *value) {
    if (reference == TIME_REFERENCE) {
        *value = motion->time;
    } else if (reference < FIRST_OUTPUT) {
        *value = motion->inputs[reference - FIRST_INPUT];
    } else if (reference < VARIABLES) {
        int output = (int)(reference - FIRST_OUTPUT);
        double sum = 0.0;
        for (int state = 0; state < STATES; state++) sum += C[output * STATES + state] * motion->states[state];
        for (int input = 0; input < INPUTS; input++) sum += D[output * INPUTS + input] * motion->inputs[input];
        *value = sum;
    } else {
        return 0;
    }
    return 1;
}

static int set_value(Motion *motion, unsigned reference, double value) {
    if (reference < FIRST_INPUT || reference >= FIRST_OUTPUT) return 0;
    motion->inputs[reference - FIRST_INPUT] = value;
    return 1;
}

/* Derivative of an output by an input as it is held: what D passes on at once. */
static int get_slope(unsigned unknown, unsigned known, double *slope) {
    if (unknown < FIRST_OUTPUT || unknown >= VARIABLES || known < FIRST_INPUT || known >= FIRST_OUTPUT) return 0;
    *slope = D[(unknown - FIRST_OUTPUT) * INPUTS + (known - FIRST_INPUT)];
    return 1;
}

static int save(const Motion *motion, void **state) {
    if (!*state) *state = malloc(sizeof(Motion));
    if (*state) memcpy(*state, motion, sizeof(Motion));
    return *state != NULL;
}
