/* FMI 3.0, co-simulation. */
#include "core.h"
#include "fmi3Functions.h"

#define MOTION(instance) (&((Machine *)(instance))->motion)

static fmi3Status refuse(fmi3Instance instance, const char *message) {
    Machine *machine = instance;
    if (machine && machine->callback)
        ((fmi3LogMessageCallback)machine->callback)(machine->environment, fmi3Error, "logStatusError", message);
    return fmi3Error;
}

static fmi3Status only_none(fmi3Instance instance, size_t count) {
    return count ? refuse(instance, "all variables are of type Float64") : fmi3OK;
}

#include "fmi3_refused.h"

const char *fmi3GetVersion(void) { return fmi3Version; }
fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t n, const fmi3String categories[]) { return fmi3OK; }

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early_return, const fmi3ValueReference required[], size_t n, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
    if (!token || strcmp(token, TOKEN)) return NULL;
    return create(name, environment, (void *)log);
}
void fmi3FreeInstance(fmi3Instance instance) { destroy(instance); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean defined, fmi3Float64 tolerance, fmi3Float64 start, fmi3Boolean stop_defined, fmi3Float64 stop) {
    MOTION(instance)->time = start;
    return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) { return fmi3OK; }
fmi3Status fmi3EnterStepMode(fmi3Instance instance) { return fmi3OK; }
fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance) { return fmi3OK; }
fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance) { return fmi3OK; }
fmi3Status fmi3Terminate(fmi3Instance instance) { return fmi3OK; }
fmi3Status fmi3Reset(fmi3Instance instance) {
    rest(instance);
    return fmi3OK;
}

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Float64 values[], size_t count) {
    if (n != count) return refuse(instance, "every variable is one number");
    for (size_t k = 0; k < n; k++)
        if (!get_value(instance, vr[k], values + k)) return refuse(instance, "unknown value reference");
    return fmi3OK;
}
fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Float64 values[], size_t count) {
    if (n != count) return refuse(instance, "every variable is one number");
    for (size_t k = 0; k < n; k++)
        if (!set_value(MOTION(instance), vr[k], values[k])) return refuse(instance, "only inputs can be set");
    return fmi3OK;
}

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state) {
    return save(MOTION(instance), state) ? fmi3OK : refuse(instance, "no memory for a state");
}
fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state) {
    if (!state) return refuse(instance, "no state");
    memcpy(MOTION(instance), state, sizeof(Motion));
    return fmi3OK;
}
fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state) {
    free(*state);
    *state = NULL;
    return fmi3OK;
}
fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t *size) {
    *size = sizeof(Motion);
    return fmi3OK;
}
fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
    if (size < sizeof(Motion)) return refuse(instance, "too little room for a state");
    memcpy(bytes, state, sizeof(Motion));
    return fmi3OK;
}
fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size, fmi3FMUState *state) {
    if (size != sizeof(Motion)) return refuse(instance, "these bytes are no state of this machine");
    return save((const Motion *)(const void *)bytes, state) ? fmi3OK : refuse(instance, "no memory for a state");
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t rows, const fmi3ValueReference knowns[], size_t columns, const fmi3Float64 seed[], size_t seeds, fmi3Float64 sensitivity[], size_t count) {
    if (seeds != columns || count != rows) return refuse(instance, "every variable is one number");
    for (size_t row = 0; row < rows; row++) {
        sensitivity[row] = 0.0;
        for (size_t column = 0; column < columns; column++) {
            double slope;
            if (!get_slope(unknowns[row], knowns[column], &slope)) return refuse(instance, "derivatives of outputs by forces are known");
            sensitivity[row] += slope * seed[column];
        }
    }
    return fmi3OK;
}
fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t rows, const fmi3ValueReference knowns[], size_t columns, const fmi3Float64 seed[], size_t seeds, fmi3Float64 sensitivity[], size_t count) {
    if (seeds != rows || count != columns) return refuse(instance, "every variable is one number");
    for (size_t column = 0; column < columns; column++) {
        sensitivity[column] = 0.0;
        for (size_t row = 0; row < rows; row++) {
            double slope;
            if (!get_slope(unknowns[row], knowns[column], &slope)) return refuse(instance, "derivatives of outputs by forces are known");
            sensitivity[column] += slope * seed[row];
        }
    }
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 now, fmi3Float64 size, fmi3Boolean no_set_state, fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early_return, fmi3Float64 *last) {
    const char *fault = do_steps(instance, now, size);
    if (fault) return refuse(instance, fault);
    *event = *terminate = *early_return = fmi3False;
    *last = MOTION(instance)->time;
    return fmi3OK;
}
