/* A machine at a fixed step with held inputs; model.h holds its numbers. The positions of its axes, where
   it has any, are inputs behind the others. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "model.h"

#define ROOM(count) ((count) > 0 ? (count) : 1) /* C knows no empty array */
enum { TIME_REFERENCE = 0, FIRST_INPUT = 1, FIRST_OUTPUT = 1 + INPUTS + AXES, VARIABLES = FIRST_OUTPUT + OUTPUTS };

typedef struct {
    double time;
    double states[ROOM(STATES)];
    double inputs[ROOM(INPUTS + AXES)];
#if AXES
    double before[AXES]; /* positions of the last step */
    int started, moved;  /* steps that follow until the axes count as resting */
#endif
} Motion;

typedef struct {
    Motion motion;
    void *environment;
    void *callback;
    char *name;
    struct Posed *posed; /* what belongs to the positions of the axes */
} Machine;

#if AXES
#include "varying.h"
#else
#include "fixed.h"
#endif

static void rest(Machine *machine) {
    memset(&machine->motion, 0, sizeof(Motion));
    for (int axis = 0; axis < AXES; axis++) machine->motion.inputs[INPUTS + axis] = START[axis];
}

static void destroy(Machine *machine) {
    if (machine) {
        free(machine->name);
        free(machine->posed);
    }
    free(machine);
}

static Machine *create(const char *name, void *environment, void *callback) {
    Machine *machine = calloc(1, sizeof(Machine));
    if (!machine) return NULL;
    machine->name = malloc(strlen(name ? name : "") + 1);
    machine->posed = calloc(1, sizeof(struct Posed));
    if (!machine->name || !machine->posed) {
        destroy(machine);
        return NULL;
    }
    strcpy(machine->name, name ? name : "");
    machine->environment = environment;
    machine->callback = callback;
    rest(machine);
    return machine;
}

/* Advances by whole steps; NULL, or why it cannot. */
static const char *do_steps(Machine *machine, double now, double size) {
    double steps = size / STEP;
    long whole = lround(steps);
    const char *fault = find_fault(machine);
    if (fault) return fault;
    if (size < 0.0 || fabs(steps - (double)whole) > 1e-6)
        return "the communication step must be a multiple of the step of the model, " STEP_TEXT " s";
    settle(machine);
    advance(machine, whole);
    machine->motion.time = now + (double)whole * STEP;
    return NULL;
}

static int get_value(Machine *machine, unsigned reference, double *value) {
    if (reference == TIME_REFERENCE) {
        *value = machine->motion.time;
    } else if (reference < FIRST_OUTPUT) {
        *value = machine->motion.inputs[reference - FIRST_INPUT];
    } else if (reference < VARIABLES) {
        settle(machine);
        *value = read_output(machine, (int)(reference - FIRST_OUTPUT));
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

/* Derivative of an output by a force as it is held: what D passes on at once. */
static int get_slope(unsigned unknown, unsigned known, double *slope) {
    if (unknown < FIRST_OUTPUT || unknown >= VARIABLES || known < FIRST_INPUT || known >= FIRST_INPUT + INPUTS) return 0;
    *slope = pass_on((int)(unknown - FIRST_OUTPUT), (int)(known - FIRST_INPUT));
    return 1;
}

static int save(const Motion *motion, void **state) {
    if (!*state) *state = malloc(sizeof(Motion));
    if (*state) memcpy(*state, motion, sizeof(Motion));
    return *state != NULL;
}
