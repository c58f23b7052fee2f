/* FMI 2.0, co-simulation. */
#include "core.h"
#include "fmi2Functions.h"

#define MOTION(c) (&((Machine *)(c))->motion)

static fmi2Status refuse(fmi2Component c, const char *message) {
    Machine *machine = c;
    if (machine && machine->callback)
        ((fmi2CallbackLogger)machine->callback)(machine->environment, machine->name, fmi2Error, "logStatusError", "%s", message);
    return fmi2Error;
}

static fmi2Status only_none(fmi2Component c, size_t count) {
    return count ? refuse(c, "all variables are of type Real") : fmi2OK;
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources, const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging) {
    if (type != fmi2CoSimulation || !guid || strcmp(guid, TOKEN)) return NULL;
    return create(name, functions ? functions->componentEnvironment : NULL, functions ? (void *)functions->logger : NULL);
}
void fmi2FreeInstance(fmi2Component c) { destroy(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean defined, fmi2Real tolerance, fmi2Real start, fmi2Boolean stop_defined, fmi2Real stop) {
    MOTION(c)->time = start;
    return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) {
    rest(c);
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    for (size_t k = 0; k < n; k++)
        if (!get_value(c, vr[k], value + k)) return refuse(c, "unknown value reference");
    return fmi2OK;
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    for (size_t k = 0; k < n; k++)
        if (!set_value(MOTION(c), vr[k], value[k])) return refuse(c, "only inputs can be set");
    return fmi2OK;
}
fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer v[]) { return only_none(c, n); }
fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Boolean v[]) { return only_none(c, n); }
fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String v[]) { return only_none(c, n); }
fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer v[]) { return only_none(c, n); }
fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Boolean v[]) { return only_none(c, n); }
fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String v[]) { return only_none(c, n); }

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    return save(MOTION(c), state) ? fmi2OK : refuse(c, "no memory for a state");
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    if (!state) return refuse(c, "no state");
    memcpy(MOTION(c), state, sizeof(Motion));
    return fmi2OK;
}
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    free(*state);
    *state = NULL;
    return fmi2OK;
}
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    *size = sizeof(Motion);
    return fmi2OK;
}
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    if (size < sizeof(Motion)) return refuse(c, "too little room for a state");
    memcpy(bytes, state, sizeof(Motion));
    return fmi2OK;
}
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    if (size != sizeof(Motion)) return refuse(c, "these bytes are no state of this machine");
    return save((const Motion *)(const void *)bytes, state) ? fmi2OK : refuse(c, "no memory for a state");
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns, const fmi2ValueReference known[], size_t knowns, const fmi2Real seed[], fmi2Real value[]) {
    for (size_t row = 0; row < unknowns; row++) {
        value[row] = 0.0;
        for (size_t column = 0; column < knowns; column++) {
            double slope;
            if (!get_slope(unknown[row], known[column], &slope)) return refuse(c, "derivatives of outputs by forces are known");
            value[row] += slope * seed[column];
        }
    }
    return fmi2OK;
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[], const fmi2Real value[]) {
    return n ? refuse(c, "inputs are held over a step") : fmi2OK;
}
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[], fmi2Real value[]) {
    return n ? refuse(c, "derivatives of outputs are not given") : fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real now, fmi2Real size, fmi2Boolean no_set_state) {
    const char *fault = do_steps(c, now, size);
    if (fault) return refuse(c, fault);
    return fmi2OK;
}
fmi2Status fmi2CancelStep(fmi2Component c) { return refuse(c, "no step is under way"); }
fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value) { return refuse(c, "steps end before they return"); }
fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    if (kind != fmi2LastSuccessfulTime) return refuse(c, "steps end before they return");
    *value = MOTION(c)->time;
    return fmi2OK;
}
fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value) { return refuse(c, "steps end before they return"); }
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    if (kind != fmi2Terminated) return refuse(c, "steps end before they return");
    *value = fmi2False;
    return fmi2OK;
}
fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value) { return refuse(c, "steps end before they return"); }
