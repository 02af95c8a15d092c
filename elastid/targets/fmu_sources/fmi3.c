/* The functions of the Functional Mock-up Interface 3.0 for co-simulation. */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "robot.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef void *Instance;
typedef uint32_t Reference;
typedef const char *String;
typedef enum { OK, WARNING, DISCARD, ERROR, FATAL } Status;
typedef void (*Logger)(void *, Status, String, String);

typedef struct {
  Robot robot;
  Logger logger;
  void *environment;
} Unit;

static Status refuse(Unit *unit, String message) {
  if (unit && unit->logger) unit->logger(unit->environment, ERROR, "logStatusError", message);
  return ERROR;
}

EXPORT String fmi3GetVersion(void) { return "3.0"; }
EXPORT Status fmi3SetDebugLogging(Instance c, bool on, size_t n, const String categories[]) {
  (void)c, (void)on, (void)n, (void)categories;
  return OK;
}

EXPORT Instance fmi3InstantiateCoSimulation(String name, String token, String resources, bool visible, bool logging,
                                            bool events, bool early, const Reference required[], size_t n,
                                            void *environment, Logger logger, void *update) {
  (void)name, (void)resources, (void)visible, (void)logging, (void)events, (void)early, (void)required, (void)n;
  (void)update;
  if (strcmp(token, GUID) != 0) return NULL;
  Unit *unit = calloc(1, sizeof *unit);
  if (!unit) return NULL;
  unit->logger = logger;
  unit->environment = environment;
  robot_reset(&unit->robot);
  return unit;
}

/* Only co-simulation is provided. */
EXPORT Instance fmi3InstantiateModelExchange(String name, String token, String resources, bool visible, bool logging,
                                             void *environment, Logger logger) {
  (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)environment, (void)logger;
  return NULL;
}
EXPORT Instance fmi3InstantiateScheduledExecution(String name, String token, String resources, bool visible,
                                                  bool logging, void *environment, Logger logger, void *update,
                                                  void *lock, void *unlock) {
  (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)environment, (void)logger;
  (void)update, (void)lock, (void)unlock;
  return NULL;
}

EXPORT void fmi3FreeInstance(Instance c) { free(c); }

EXPORT Status fmi3EnterInitializationMode(Instance c, bool has_tolerance, double tolerance, double start, bool has_stop,
                                          double stop) {
  (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
  ((Unit *)c)->robot.time = start;
  return OK;
}

EXPORT Status fmi3ExitInitializationMode(Instance c) {
  return robot_start(&((Unit *)c)->robot) ? refuse(c, START_REFUSED) : OK;
}

EXPORT Status fmi3Terminate(Instance c) {
  (void)c;
  return OK;
}
EXPORT Status fmi3EnterEventMode(Instance c) {
  (void)c;
  return OK;
}
EXPORT Status fmi3EnterStepMode(Instance c) {
  (void)c;
  return OK;
}
EXPORT Status fmi3UpdateDiscreteStates(Instance c, bool *again, bool *terminate, bool *nominals, bool *values,
                                       bool *has_next, double *next) {
  (void)c;
  *again = *terminate = *nominals = *values = *has_next = false;
  *next = 0;
  return OK;
}

EXPORT Status fmi3Reset(Instance c) {
  robot_reset(&((Unit *)c)->robot);
  return OK;
}

EXPORT Status fmi3GetFloat64(Instance c, const Reference r[], size_t n, double value[], size_t n_values) {
  Unit *unit = c;
  (void)n_values;
  if (!unit->robot.started) {
    Robot ready = unit->robot;
    if (!robot_start(&ready)) memcpy(unit->robot.value, ready.value, sizeof ready.value);
  }
  for (size_t i = 0; i < n; i++) {
    if (r[i] >= N_VALUES) return refuse(unit, "a value reference that no variable of type Float64 has");
    value[i] = unit->robot.value[r[i]];
  }
  return OK;
}

EXPORT Status fmi3SetFloat64(Instance c, const Reference r[], size_t n, const double value[], size_t n_values) {
  Unit *unit = c;
  (void)n_values;
  for (size_t i = 0; i < n; i++) {
    if (r[i] >= N_VALUES || !robot_may_set((int)r[i], unit->robot.started))
      return refuse(unit, "a variable that cannot be set, or not any more");
    unit->robot.value[r[i]] = value[i];
  }
  return OK;
}

EXPORT Status fmi3GetInt32(Instance c, const Reference r[], size_t n, int32_t value[], size_t n_values) {
  (void)n_values;
  for (size_t i = 0; i < n; i++) {
    if (r[i] != N_VALUES) return refuse(c, "a value reference that no variable of type Int32 has");
    value[i] = ((Unit *)c)->robot.configuration;
  }
  return OK;
}

EXPORT Status fmi3SetInt32(Instance c, const Reference r[], size_t n, const int32_t value[], size_t n_values) {
  (void)n_values;
  for (size_t i = 0; i < n; i++) {
    if (r[i] != N_VALUES || ((Unit *)c)->robot.started) return refuse(c, "a configuration is chosen before the start");
    ((Unit *)c)->robot.configuration = value[i];
  }
  return OK;
}

EXPORT Status fmi3DoStep(Instance c, double at, double step, bool no_state_before, bool *has_event, bool *terminate,
                         bool *early, double *last) {
  Unit *unit = c;
  (void)at, (void)no_state_before;
  const int failed = robot_advance(&unit->robot, step);
  *has_event = *terminate = *early = false;
  *last = unit->robot.time;
  return failed ? refuse(unit, LOST) : OK;
}

EXPORT Status fmi3GetFMUState(Instance c, void **state) {
  if (!*state) *state = malloc(sizeof(Robot));
  if (!*state) return refuse(c, "no memory is left for a state");
  memcpy(*state, &((Unit *)c)->robot, sizeof(Robot));
  return OK;
}

EXPORT Status fmi3SetFMUState(Instance c, void *state) {
  memcpy(&((Unit *)c)->robot, state, sizeof(Robot));
  return OK;
}

EXPORT Status fmi3FreeFMUState(Instance c, void **state) {
  (void)c;
  free(*state);
  *state = NULL;
  return OK;
}

EXPORT Status fmi3SerializedFMUStateSize(Instance c, void *state, size_t *size) {
  (void)c, (void)state;
  *size = sizeof(Robot);
  return OK;
}

EXPORT Status fmi3SerializeFMUState(Instance c, void *state, uint8_t bytes[], size_t size) {
  if (size < sizeof(Robot)) return refuse(c, "too few bytes for a state");
  memcpy(bytes, state, sizeof(Robot));
  return OK;
}

EXPORT Status fmi3DeserializeFMUState(Instance c, const uint8_t bytes[], size_t size, void **state) {
  if (size != sizeof(Robot)) return refuse(c, "these bytes are not of a state of this unit");
  if (!*state) *state = malloc(sizeof(Robot));
  if (!*state) return refuse(c, "no memory is left for a state");
  memcpy(*state, bytes, sizeof(Robot));
  return OK;
}

/* Nothing of these types, and nothing of the other kinds of unit. The arguments that follow are not looked at. */
#define NOT_PROVIDED(name) \
  EXPORT Status fmi3##name(Instance c) { return refuse(c, #name " is not provided"); }
#define NONE_OF(type) NOT_PROVIDED(Get##type) NOT_PROVIDED(Set##type)
NONE_OF(Float32)
NONE_OF(Int8)
NONE_OF(UInt8)
NONE_OF(Int16)
NONE_OF(UInt16)
NONE_OF(UInt32)
NONE_OF(Int64)
NONE_OF(UInt64)
NONE_OF(Boolean)
NONE_OF(String)
NONE_OF(Binary)
NONE_OF(Clock)
NONE_OF(IntervalDecimal)
NONE_OF(IntervalFraction)
NONE_OF(ShiftDecimal)
NONE_OF(ShiftFraction)
NONE_OF(ContinuousStates)
NOT_PROVIDED(GetNumberOfVariableDependencies)
NOT_PROVIDED(GetVariableDependencies)
NOT_PROVIDED(GetDirectionalDerivative)
NOT_PROVIDED(GetAdjointDerivative)
NOT_PROVIDED(EnterConfigurationMode)
NOT_PROVIDED(ExitConfigurationMode)
NOT_PROVIDED(EvaluateDiscreteStates)
NOT_PROVIDED(EnterContinuousTimeMode)
NOT_PROVIDED(CompletedIntegratorStep)
NOT_PROVIDED(SetTime)
NOT_PROVIDED(GetContinuousStateDerivatives)
NOT_PROVIDED(GetEventIndicators)
NOT_PROVIDED(GetNominalsOfContinuousStates)
NOT_PROVIDED(GetNumberOfEventIndicators)
NOT_PROVIDED(GetNumberOfContinuousStates)
NOT_PROVIDED(GetOutputDerivatives)
NOT_PROVIDED(ActivateModelPartition)
