/* A machine whose matrices depend on positions of axes:  z'' + C z' + K z = B u,  y = L z.
   K = diag(SQUARES) + R^T k R  with rows R of joints that slide; positions are constant over a step.
   While axes move, a step is the rational approximation of the exponential that is left at infinity by
   motions far faster than the step:  x+ = 2 Re sum_i c_i (h A - s_i)^-1 (x + h B u / s_i).  Where the
   axes rest, it is exact and kept as one matrix.  States are (RATE z, z'). */
#define MODES (STATES / 2)
#define EIGHTS(count) (((count) + 7) / 8 * 8) /* rows of arrays hold whole vectors of a processor */
#define WIDTH EIGHTS(ROOM(JOINT_ROWS))
#define LENGTH EIGHTS(MODES)
#define HALVINGS ((int)fmax(0.0, ceil(log2(STEP * RATE))))
enum { MOST_TERMS = 80, MOST_ROUNDS = 20, RESTING = 100, FURTHER = 3 * SPRINGS, LOADS, ROWS };

#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__)
#define FAST __attribute__((target_clones("avx2", "default")))
#else
#define FAST
#endif

typedef struct Posed {
    int settled, filled, placed, whole, kept;
    double positions[AXES];
    double loads[ROOM(INPUTS * MODES)];
    double rows[ROOM(OUTPUTS * MODES)];
    double weights[2 * AXES][MOST_KNOTS];
    double joints[WIDTH * LENGTH];        /* row by row */
    double motions[LENGTH * WIDTH];       /* the same mode by mode */
    double springs[WIDTH * WIDTH], dampers[WIDTH * WIDTH];
    double damping[MODES * MODES];        /* of all but joints that slide */
    double diagonal[LENGTH];
    double stiffness[MODES * MODES];      /* of all, over RATE */
    double whole_damping[MODES * MODES];
    double transition[STATES * (STATES + INPUTS)]; /* column by column */
    double spare[STATES * (STATES + INPUTS)];
} Posed;

/* A complex matrix I + kappa R G R^T and what else belongs to a pole. */
typedef struct {
    double real[LENGTH], imag[LENGTH]; /* G: the inverse of what is diagonal */
    double lu_real[WIDTH * WIDTH], lu_imag[WIDTH * WIDTH];
    double kappa_real[WIDTH * WIDTH], kappa_imag[WIDTH * WIDTH];
    int pivots[WIDTH];
} Pole;

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

/* Evaluates channels at the positions, where these changed. */
static void settle(Machine *machine) {
    Posed *posed = machine->posed;
    const double *positions = machine->motion.inputs + INPUTS;
    if (posed->settled && !memcmp(posed->positions, positions, sizeof posed->positions)) return;
    memcpy(posed->positions, positions, sizeof posed->positions);
    posed->settled = 1;
    posed->placed = posed->whole = posed->kept = 0;
    for (int set = 0; set < 2 * AXES; set++) weigh(set, positions[set % AXES], posed->weights[set]);
    evaluate(FIELDS + LOADS, posed->weights, posed->loads);
    evaluate(FIELDS + ROWS, posed->weights, posed->rows);
}

/* Evaluates joints and the damping of all else. */
FAST static void place(Posed *posed) {
    double amounts[ROOM(MIXED)], rows[ROOM(MOST_ROWS * MODES)], matrix[ROOM(MOST_ROWS * MOST_ROWS)];
    if (posed->placed) return;
    posed->placed = 1;
    if (MIXED || !posed->filled) memcpy(posed->damping, DAMPING, sizeof posed->damping);
    posed->filled = 1;
    evaluate(FIELDS + FURTHER, posed->weights, amounts);
    for (int pattern = 0; pattern < MIXED; pattern++)
        for (int k = 0; k < MODES * MODES; k++) posed->damping[k] += amounts[pattern] * PATTERNS[(size_t)pattern * MODES * MODES + k];
    for (int mode = 0; mode < MODES; mode++) posed->diagonal[mode] = posed->damping[mode * MODES + mode];
    for (int spring = 0, first = 0; spring < SPRINGS; spring++) {
        const Field *field = FIELDS + 3 * spring;
        int count = field->size / MODES;
        evaluate(field, posed->weights, rows);
        for (int row = 0; row < count; row++)
            for (int mode = 0; mode < MODES; mode++)
                posed->joints[(first + row) * LENGTH + mode] = posed->motions[mode * WIDTH + first + row] = rows[row * MODES + mode];
        for (int part = 1; part < 3; part++) {
            double *block = part == 1 ? posed->springs : posed->dampers;
            evaluate(field + part, posed->weights, matrix);
            for (int k = 0; k < count * count; k++) block[(first + k / count) * WIDTH + first + k % count] = matrix[k];
        }
        first += count;
    }
}

/* Adds R^T A R to a matrix that stands column by column. */
FAST static void add_joints(const Posed *posed, double *total, const double *matrix) {
    for (int row = 0; row < JOINT_ROWS; row++) {
        double force[LENGTH] = {0.0};
        for (int other = 0; other < JOINT_ROWS; other++)
            for (int mode = 0; matrix[row * WIDTH + other] != 0.0 && mode < MODES; mode++)
                force[mode] += matrix[row * WIDTH + other] * posed->joints[other * LENGTH + mode];
        for (int mode = 0; mode < MODES; mode++)
            for (int first = 0; first < MODES; first++)
                total[mode * MODES + first] += posed->joints[row * LENGTH + first] * force[mode];
    }
}

/* Puts whole matrices together. */
static void assemble(Posed *posed) {
    place(posed);
    if (posed->whole) return;
    posed->whole = 1;
    memcpy(posed->whole_damping, posed->damping, sizeof posed->damping);
    memset(posed->stiffness, 0, sizeof posed->stiffness);
    for (int mode = 0; mode < MODES; mode++) posed->stiffness[mode * MODES + mode] = SQUARES[mode];
    add_joints(posed, posed->stiffness, posed->springs);
    add_joints(posed, posed->whole_damping, posed->dampers);
    for (int k = 0; k < MODES * MODES; k++) posed->stiffness[k] /= RATE;
}

/* Advances states by a part of a step under a constant force: a Taylor series. */
FAST static void integrate(const Posed *posed, double *x, const double *force, double part) {
    double term[STATES], next[STATES];
    memcpy(term, x, sizeof term);
    for (int order = 1; order <= MOST_TERMS; order++) {
        double size = 0.0, whole = 0.0;
        for (int mode = 0; mode < MODES; mode++) {
            next[mode] = RATE * term[MODES + mode];
            next[MODES + mode] = order == 1 ? force[mode] : 0.0;
        }
        for (int column = 0; column < MODES; column++) {
            const double *stiffness = posed->stiffness + column * MODES, *damping = posed->whole_damping + column * MODES;
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

/* Adds a matrix (STATES, STATES), column by column, times a column. */
FAST static void multiply(const double *matrix, const double *column, double *sum) {
    for (int k = 0; k < STATES; k += 2) { /* the number of states is even */
        const double *first = matrix + k * STATES, *second = first + STATES, one = column[k], two = column[k + 1];
        for (int row = 0; row < STATES; row++) sum[row] += first[row] * one + second[row] * two;
    }
}

/* Makes the matrix of an exact step of the one of a short one, squared again and again. */
static void keep_step(Posed *posed) {
    double force[MODES];
    assemble(posed);
    posed->kept = 1;
    memset(posed->transition, 0, sizeof posed->transition);
    for (int column = 0; column < STATES + INPUTS; column++) {
        memset(force, 0, sizeof force);
        if (column < STATES) posed->transition[column * STATES + column] = 1.0;
        else memcpy(force, posed->loads + (column - STATES) * MODES, sizeof force);
        integrate(posed, posed->transition + column * STATES, force, ldexp(STEP, -HALVINGS));
    }
    for (int halving = 0; halving < HALVINGS; halving++) {
        memset(posed->spare, 0, STATES * STATES * sizeof(double));
        memcpy(posed->spare + STATES * STATES, posed->transition + STATES * STATES, STATES * INPUTS * sizeof(double));
        for (int column = 0; column < STATES + INPUTS; column++)
            multiply(posed->transition, posed->transition + column * STATES, posed->spare + column * STATES);
        memcpy(posed->transition, posed->spare, sizeof posed->transition);
    }
}

/* Forms R G R^T, eight entries at a time. */
static inline void couple(const Posed *posed, const Pole *pole, double *restrict real, double *restrict imag) {
    for (int row = 0; row < JOINT_ROWS; row++) {
        const double *joint = posed->joints + row * LENGTH;
        double one[LENGTH], two[LENGTH];
        for (int mode = 0; mode < LENGTH; mode++) {
            one[mode] = joint[mode] * pole->real[mode];
            two[mode] = joint[mode] * pole->imag[mode];
        }
        for (int from = 0; from <= row; from += 8) {
            const double *motion = posed->motions + from;
            double sum[8] = {0.0}, sum_imag[8] = {0.0};
            for (int mode = 0; mode < LENGTH; mode++, motion += WIDTH)
                for (int k = 0; k < 8; k++) {
                    sum[k] += one[mode] * motion[k];
                    sum_imag[k] += two[mode] * motion[k];
                }
            memcpy(real + row * WIDTH + from, sum, sizeof sum);
            memcpy(imag + row * WIDTH + from, sum_imag, sizeof sum);
        }
        for (int k = 0; k < row; k++) {
            real[k * WIDTH + row] = real[row * WIDTH + k];
            imag[k * WIDTH + row] = imag[row * WIDTH + k];
        }
    }
}

/* Factors I + kappa R G R^T of a pole. */
FAST static void factor(const Posed *posed, Pole *pole, double real, double imag) {
    double gamma_real[WIDTH * WIDTH] = {0.0}, gamma_imag[WIDTH * WIDTH] = {0.0}, *re = pole->lu_real, *im = pole->lu_imag;
    memset(pole, 0, sizeof *pole);
    for (int mode = 0; mode < MODES; mode++) {
        double a = real * real - imag * imag + real * STEP * posed->diagonal[mode] + STEP * STEP * SQUARES[mode];
        double b = 2.0 * real * imag + imag * STEP * posed->diagonal[mode], size = a * a + b * b;
        pole->real[mode] = a / size;
        pole->imag[mode] = -b / size;
    }
    couple(posed, pole, gamma_real, gamma_imag);
    for (int row = 0; row < JOINT_ROWS; row++) {
        re[row * WIDTH + row] = 1.0;
        for (int other = 0; other < JOINT_ROWS; other++) {
            int at = row * WIDTH + other;
            double a = STEP * STEP * posed->springs[at] + real * STEP * posed->dampers[at], b = imag * STEP * posed->dampers[at];
            pole->kappa_real[at] = a;
            pole->kappa_imag[at] = b;
            for (int k = 0; (a != 0.0 || b != 0.0) && k < WIDTH; k++) {
                re[row * WIDTH + k] += a * gamma_real[other * WIDTH + k] - b * gamma_imag[other * WIDTH + k];
                im[row * WIDTH + k] += a * gamma_imag[other * WIDTH + k] + b * gamma_real[other * WIDTH + k];
            }
        }
    }
    for (int column = 0; column < JOINT_ROWS; column++) {
        int best = column;
        double a, b, size;
        for (int row = column; row < JOINT_ROWS; row++)
            if (fabs(re[row * WIDTH + column]) + fabs(im[row * WIDTH + column]) > fabs(re[best * WIDTH + column]) + fabs(im[best * WIDTH + column])) best = row;
        pole->pivots[column] = best;
        for (int k = 0; best != column && k < WIDTH; k++) {
            double here = re[column * WIDTH + k], there = im[column * WIDTH + k];
            re[column * WIDTH + k] = re[best * WIDTH + k];
            im[column * WIDTH + k] = im[best * WIDTH + k];
            re[best * WIDTH + k] = here;
            im[best * WIDTH + k] = there;
        }
        a = re[column * WIDTH + column];
        b = im[column * WIDTH + column];
        size = a * a + b * b;
        re[column * WIDTH + column] = a /= size; /* its inverse */
        im[column * WIDTH + column] = b /= -size;
        for (int row = column + 1; row < JOINT_ROWS; row++) {
            double c = re[row * WIDTH + column], d = im[row * WIDTH + column], e = a * c - b * d, f = a * d + b * c;
            for (int k = column + 1; k < WIDTH; k++) {
                re[row * WIDTH + k] -= e * re[column * WIDTH + k] - f * im[column * WIDTH + k];
                im[row * WIDTH + k] -= e * im[column * WIDTH + k] + f * re[column * WIDTH + k];
            }
            re[row * WIDTH + column] = e;
            im[row * WIDTH + column] = f;
        }
    }
}

/* Solves (s^2 + s h C + h^2 K) p = r in place, of C what is diagonal or in joints (Woodbury). */
FAST static void solve(const Posed *posed, const Pole *pole, double *real, double *imag) {
    double forces[2][WIDTH] = {{0.0}}, y[2][WIDTH] = {{0.0}}, back[2][LENGTH] = {{0.0}};
    for (int mode = 0; mode < MODES; mode++) {
        double a = real[mode], b = imag[mode];
        real[mode] = pole->real[mode] * a - pole->imag[mode] * b;
        imag[mode] = pole->real[mode] * b + pole->imag[mode] * a;
        for (int row = 0; row < WIDTH; row++) {
            y[0][row] += posed->motions[mode * WIDTH + row] * real[mode];
            y[1][row] += posed->motions[mode * WIDTH + row] * imag[mode];
        }
    }
    for (int row = 0; row < JOINT_ROWS; row++)
        for (int k = 0; k < JOINT_ROWS; k++) {
            forces[0][row] += pole->kappa_real[row * WIDTH + k] * y[0][k] - pole->kappa_imag[row * WIDTH + k] * y[1][k];
            forces[1][row] += pole->kappa_real[row * WIDTH + k] * y[1][k] + pole->kappa_imag[row * WIDTH + k] * y[0][k];
        }
    for (int row = 0; row < JOINT_ROWS; row++)
        for (int part = 0; part < 2; part++) {
            double swapped = forces[part][row];
            forces[part][row] = forces[part][pole->pivots[row]];
            forces[part][pole->pivots[row]] = swapped;
        }
    for (int up = 0; up < 2; up++)
        for (int step = 0; step < JOINT_ROWS; step++) {
            int row = up ? JOINT_ROWS - 1 - step : step, end = up ? JOINT_ROWS : row;
            double a = forces[0][row], b = forces[1][row];
            for (int k = up ? row + 1 : 0; k < end; k++) {
                a -= pole->lu_real[row * WIDTH + k] * forces[0][k] - pole->lu_imag[row * WIDTH + k] * forces[1][k];
                b -= pole->lu_real[row * WIDTH + k] * forces[1][k] + pole->lu_imag[row * WIDTH + k] * forces[0][k];
            }
            forces[0][row] = up ? pole->lu_real[row * WIDTH + row] * a - pole->lu_imag[row * WIDTH + row] * b : a;
            forces[1][row] = up ? pole->lu_real[row * WIDTH + row] * b + pole->lu_imag[row * WIDTH + row] * a : b;
        }
    for (int row = 0; row < JOINT_ROWS; row++)
        for (int mode = 0; mode < MODES; mode++) {
            back[0][mode] += posed->joints[row * LENGTH + mode] * forces[0][row];
            back[1][mode] += posed->joints[row * LENGTH + mode] * forces[1][row];
        }
    for (int mode = 0; mode < MODES; mode++) {
        real[mode] -= pole->real[mode] * back[0][mode] - pole->imag[mode] * back[1][mode];
        imag[mode] -= pole->real[mode] * back[1][mode] + pole->imag[mode] * back[0][mode];
    }
}

/* Adds -h times the damping between modes times columns. */
FAST static void damp(const Posed *posed, const double *real, const double *imag, double *sum, double *sum_imag) {
    for (int column = 0; column < MODES; column++) {
        const double *damping = posed->damping + column * MODES, one = -STEP * real[column], two = -STEP * imag[column];
        for (int mode = 0; mode < MODES; mode++) {
            sum[mode] += damping[mode] * one;
            sum_imag[mode] += damping[mode] * two;
        }
        sum[column] -= posed->diagonal[column] * one;
        sum_imag[column] -= posed->diagonal[column] * two;
    }
}

/* Adds what the damping between modes does to a solution, round by round; 0 where that does not end. */
static int correct(const Posed *posed, const Pole *pole, const double *s, double *real, double *imag) {
    double rest[2][LENGTH], moved[2][LENGTH];
    memcpy(rest[0], real, sizeof rest[0]);
    memcpy(rest[1], imag, sizeof rest[1]);
    for (int round = 0; round < MOST_ROUNDS; round++) {
        double size = 0.0, whole = 0.0;
        memset(moved, 0, sizeof moved);
        damp(posed, rest[0], rest[1], moved[0], moved[1]);
        for (int mode = 0; mode < MODES; mode++) {
            rest[0][mode] = s[0] * moved[0][mode] - s[1] * moved[1][mode];
            rest[1][mode] = s[0] * moved[1][mode] + s[1] * moved[0][mode];
        }
        solve(posed, pole, rest[0], rest[1]);
        for (int mode = 0; mode < MODES; mode++) {
            real[mode] += rest[0][mode];
            imag[mode] += rest[1][mode];
            size = fmax(size, fabs(rest[0][mode]) + fabs(rest[1][mode]));
            whole = fmax(whole, fabs(real[mode]) + fabs(imag[mode]));
        }
        if (size <= 1e-13 * whole) return 1;
    }
    return 0;
}

/* Advances states by a step along the travel; 0 where the damping is too strong for it. */
static int move(const Posed *posed, double *x, const double *force) {
    double damped[LENGTH] = {0.0}, nothing[LENGTH] = {0.0}, unused[LENGTH] = {0.0}, at[LENGTH], slid[WIDTH] = {0.0}, next[STATES] = {0.0};
    static const double *poles = POLES_AND_SHARES;
    Pole pole;
    for (int mode = 0; mode < MODES; mode++) {
        at[mode] = x[mode] / RATE;
        for (int row = 0; row < JOINT_ROWS; row++) slid[row] += posed->motions[mode * WIDTH + row] * at[mode];
    }
    if (COUPLED) damp(posed, at, nothing, damped, unused); /* -h C z */
    for (int mode = 0; mode < MODES; mode++) damped[mode] -= STEP * posed->diagonal[mode] * at[mode];
    for (int row = 0; row < JOINT_ROWS; row++) {
        double pushed = 0.0;
        for (int other = 0; other < JOINT_ROWS; other++) pushed += posed->dampers[row * WIDTH + other] * slid[other];
        for (int mode = 0; mode < MODES; mode++) damped[mode] -= STEP * posed->joints[row * LENGTH + mode] * pushed;
    }
    for (int k = 0; k < POLES; k++) {
        const double *s = poles + 4 * k, *share = s + 2, size = s[0] * s[0] + s[1] * s[1];
        double real[LENGTH], imag[LENGTH];
        factor(posed, &pole, s[0], s[1]);
        for (int mode = 0; mode < MODES; mode++) {
            real[mode] = damped[mode] - STEP * (x[MODES + mode] + STEP * force[mode] * s[0] / size) - s[0] * at[mode];
            imag[mode] = STEP * STEP * force[mode] * s[1] / size - s[1] * at[mode];
        }
        solve(posed, &pole, real, imag);
        if (COUPLED && !correct(posed, &pole, s, real, imag)) return 0;
        for (int mode = 0; mode < MODES; mode++) {
            double speed = at[mode] + s[0] * real[mode] - s[1] * imag[mode], turned = s[0] * imag[mode] + s[1] * real[mode];
            next[mode] += 2.0 * RATE * (share[0] * real[mode] - share[1] * imag[mode]);
            next[MODES + mode] += 2.0 / STEP * (share[0] * speed - share[1] * turned);
        }
    }
    memcpy(x, next, sizeof next);
    return 1;
}

static const char *find_fault(const Machine *machine) {
    for (int axis = 0; axis < AXES; axis++) {
        double position = machine->motion.inputs[INPUTS + axis];
        if (!(position >= LOWEST[axis] && position <= HIGHEST[axis])) return FAULTS[axis];
    }
    return NULL;
}

static void advance(Machine *machine, long steps) {
    Motion *motion = &machine->motion;
    Posed *posed = machine->posed;
    double *x = motion->states, *u = motion->inputs, force[MODES], next[STATES];
    memset(force, 0, sizeof force);
    for (int input = 0; input < INPUTS; input++)
        for (int mode = 0; mode < MODES; mode++) force[mode] += posed->loads[input * MODES + mode] * u[input];
    if (motion->started && memcmp(motion->before, u + INPUTS, sizeof posed->positions)) motion->moved = RESTING;
    motion->started = 1;
    memcpy(motion->before, u + INPUTS, sizeof posed->positions);
    for (long step = 0; step < steps; step++) {
        if (motion->moved) {
            motion->moved--;
            place(posed);
            if (move(posed, x, force)) continue;
            assemble(posed);
            for (int part = 0; part < 1 << HALVINGS; part++) integrate(posed, x, force, ldexp(STEP, -HALVINGS));
            continue;
        }
        if (!posed->kept) keep_step(posed);
        memset(next, 0, sizeof next);
        for (int input = 0; input < INPUTS; input++)
            for (int row = 0; row < STATES; row++) next[row] += posed->transition[(STATES + input) * STATES + row] * u[input];
        multiply(posed->transition, x, next);
        memcpy(x, next, sizeof next);
    }
}

static double read_output(const Machine *machine, int output) {
    double sum = 0.0;
    for (int mode = 0; mode < MODES; mode++) sum += machine->posed->rows[output * MODES + mode] * machine->motion.states[mode] / RATE;
    return sum;
}

static double pass_on(int output, int input) { return 0.0; }
