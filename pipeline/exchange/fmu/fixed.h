/* A linear machine at a fixed step with held inputs:  x+ = A x + B u,  y = C x + D u.
   A stands as blocks of two states, then one dense block. */
#define PAIRED (2 * PAIRS)

typedef struct Posed {
    char nothing;
} Posed;

static void settle(Machine *machine) {}

static const char *find_fault(const Machine *machine) { return NULL; }

static void advance(Machine *machine, long steps) {
    Motion *motion = &machine->motion;
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
}

static double read_output(const Machine *machine, int output) {
    double sum = 0.0;
    for (int state = 0; state < STATES; state++) sum += C[output * STATES + state] * machine->motion.states[state];
    for (int input = 0; input < INPUTS; input++) sum += D[output * INPUTS + input] * machine->motion.inputs[input];
    return sum;
}

static double pass_on(int output, int input) { return D[output * INPUTS + input]; }
