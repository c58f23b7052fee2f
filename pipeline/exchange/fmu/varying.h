/* A machine whose matrices depend on positions of axes:  z'' + C z' + K z = B u,  y = L z.
   Over a step the positions are constant and the solution is exact: a Taylor series of the motion itself,
   in parts of a step. Where the axes rest for long, it is kept as one matrix.
   States are (RATE z, z'). */
#define MODES (STATES / 2)
#define SUBSTEPS ((int)ceil(STEP * RATE / 8.0))
enum { MOST_TERMS = 80, FURTHER = 3 * SPRINGS, LOADS, ROWS };

typedef struct Posed {
    int settled;
    double positions[AXES];
    double stiffness[MODES * MODES]; /* over RATE, column by column, as the others */
    double damping[MODES * MODES];
    double loads[ROOM(INPUTS * MODES)];
    double rows[ROOM(OUTPUTS * MODES)];
    long held; /* steps at these positions */
    double transition[STATES * STATES];
    double drive[ROOM(STATES * INPUTS)];
} Posed;

/* Weights of the knots; those of all axes stand twice, of joints and of channels. */
static void weigh(int set, double position, double *weights) {
    int count = COUNTS[set], pieces = count > 1 ? count - 1 : 1, piece = 0;
    while (piece < pieces - 1 && position > KNOTS[set][piece + 1]) piece++;
    position -= KNOTS[set][piece];
    for (int knot = 0; knot < count; knot++) {
        weights[knot] = 0.0;
        for (int power = 0; power < 4; power++)
            weights[knot] = weights[knot] * position + PIECES[set][(power * pieces + piece) * count + knot];
    }
}

/* An array at weights of the knots of each axis. */
static void evaluate(const Field *field, double both[2 * AXES][MOST_KNOTS], double *value) {
    double(*weights)[MOST_KNOTS] = both + field->level * AXES;
    int points = 1;
    for (int axis = 0; axis < AXES; axis++) points *= field->counts[axis];
    memset(value, 0, field->size * sizeof(double));
    for (int point = 0; point < points; point++) {
        double weight = 1.0;
        for (int axis = AXES - 1, rest = point; axis >= 0; axis--) {
            if (field->counts[axis] > 1) weight *= weights[axis][rest % field->counts[axis]];
            rest /= field->counts[axis];
        }
        for (int k = 0; k < field->size; k++) value[k] += weight * field->values[(size_t)point * field->size + k];
    }
}

/* Adds R^T A R of rows (count, MODES) to a matrix that stands column by column. */
static void add_spring(double *total, const double *rows, const double *matrix, int count) {
    for (int row = 0; row < count; row++) {
        double force[MODES];
        int acts = 0;
        memset(force, 0, sizeof force);
        for (int other = 0; other < count; other++)
            if (matrix[row * count + other] != 0.0) {
                acts = 1;
                for (int mode = 0; mode < MODES; mode++) force[mode] += matrix[row * count + other] * rows[other * MODES + mode];
            }
        for (int first = 0; acts && first < MODES; first++)
            for (int mode = 0; mode < MODES; mode++) total[mode * MODES + first] += rows[row * MODES + first] * force[mode];
    }
}

/* Puts the matrices of the positions together, where these changed. */
static void settle(Machine *machine) {
    Posed *posed = machine->posed;
    const double *positions = machine->motion.inputs + INPUTS;
    double weights[2 * AXES][MOST_KNOTS], rows[ROOM(MOST_ROWS * MODES)], matrix[ROOM(MOST_ROWS * MOST_ROWS)], amounts[ROOM(MIXED)];
    if (posed->settled && !memcmp(posed->positions, positions, sizeof posed->positions)) return;
    posed->settled = 1;
    posed->held = 0;
    memcpy(posed->positions, positions, sizeof posed->positions);
    for (int set = 0; set < 2 * AXES; set++) weigh(set, positions[set % AXES], weights[set]);
    evaluate(FIELDS + FURTHER, weights, amounts);
    evaluate(FIELDS + LOADS, weights, posed->loads);
    evaluate(FIELDS + ROWS, weights, posed->rows);
    memcpy(posed->stiffness, STIFFNESS, sizeof posed->stiffness);
    memcpy(posed->damping, DAMPING, sizeof posed->damping);
    for (int pattern = 0; pattern < MIXED; pattern++)
        for (int k = 0; k < MODES * MODES; k++) posed->damping[k] += amounts[pattern] * PATTERNS[(size_t)pattern * MODES * MODES + k];
    for (int spring = 0; spring < SPRINGS; spring++) {
        const Field *field = FIELDS + 3 * spring;
        int count = field->size / MODES;
        evaluate(field, weights, rows);
        evaluate(field + 1, weights, matrix);
        add_spring(posed->stiffness, rows, matrix, count);
        evaluate(field + 2, weights, matrix);
        add_spring(posed->damping, rows, matrix, count);
    }
    for (int k = 0; k < MODES * MODES; k++) posed->stiffness[k] /= RATE;
}

/* Advances states by a step under a constant force. */
static void integrate(const Posed *posed, double *x, const double *force) {
    double term[STATES], next[STATES], part = STEP / SUBSTEPS;
    for (int substep = 0; substep < SUBSTEPS; substep++) {
        memcpy(term, x, sizeof term);
        for (int order = 1; order <= MOST_TERMS; order++) {
            double size = 0.0, whole = 0.0;
            for (int mode = 0; mode < MODES; mode++) {
                next[mode] = RATE * term[MODES + mode];
                next[MODES + mode] = order == 1 ? force[mode] : 0.0;
            }
            for (int column = 0; column < MODES; column++) {
                const double *stiffness = posed->stiffness + column * MODES, *damping = posed->damping + column * MODES;
                const double moved = term[column], speed = term[MODES + column];
                for (int mode = 0; mode < MODES; mode++) next[MODES + mode] -= stiffness[mode] * moved + damping[mode] * speed;
            }
            for (int state = 0; state < STATES; state++) {
                term[state] = next[state] * (part / order);
                x[state] += term[state];
                size = fmax(size, fabs(term[state]));
                whole = fmax(whole, fabs(x[state]));
            }
            if (size <= 1e-17 * whole) break;
        }
    }
}

static void keep_step(Posed *posed) {
    double x[STATES], force[MODES];
    for (int column = 0; column < STATES + INPUTS; column++) {
        memset(x, 0, sizeof x);
        memset(force, 0, sizeof force);
        if (column < STATES) x[column] = 1.0;
        else memcpy(force, posed->loads + (column - STATES) * MODES, sizeof force);
        integrate(posed, x, force);
        if (column < STATES) memcpy(posed->transition + column * STATES, x, sizeof x);
        else memcpy(posed->drive + (column - STATES) * STATES, x, sizeof x);
    }
}

static const char *find_fault(const Machine *machine) {
    for (int axis = 0; axis < AXES; axis++) {
        double position = machine->motion.inputs[INPUTS + axis];
        if (!(position >= LOWEST[axis] && position <= HIGHEST[axis])) return FAULTS[axis];
    }
    return NULL;
}

static void advance(Machine *machine, long steps) {
    Posed *posed = machine->posed;
    double *x = machine->motion.states, *u = machine->motion.inputs, force[MODES], next[STATES];
    memset(force, 0, sizeof force);
    for (int input = 0; input < INPUTS; input++)
        for (int mode = 0; mode < MODES; mode++) force[mode] += posed->loads[input * MODES + mode] * u[input];
    for (long step = 0; step < steps; step++) {
        if (++posed->held <= STATES + INPUTS) {
            integrate(posed, x, force);
            continue;
        }
        if (posed->held == STATES + INPUTS + 1) keep_step(posed);
        memset(next, 0, sizeof next);
        for (int input = 0; input < INPUTS; input++)
            for (int row = 0; row < STATES; row++) next[row] += posed->drive[input * STATES + row] * u[input];
        for (int column = 0; column < STATES; column++) {
            const double *transition = posed->transition + column * STATES, size = x[column];
            for (int row = 0; row < STATES; row++) next[row] += transition[row] * size;
        }
        memcpy(x, next, sizeof next);
    }
}

static double read_output(const Machine *machine, int output) {
    double sum = 0.0;
    for (int mode = 0; mode < MODES; mode++) sum += machine->posed->rows[output * MODES + mode] * machine->motion.states[mode] / RATE;
    return sum;
}

static double pass_on(int output, int input) { return 0.0; }
