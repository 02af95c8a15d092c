/* The functions of the Functional Mock-up Interface 2.0 for co-simulation. */
#include <stdlib.h>
#include <string.h>

#include "robot.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef void *Component;
typedef unsigned int Reference;
typedef const char *String;
typedef enum { OK, WARNING, DISCARD, ERROR, FATAL, PENDING } Status;
typedef void (*Logger)(void *, String, Status, String, String, ...);
typedef struct {
  Logger logger;
  void *(*allocate)(size_t, size_t);
  void (*release)(void *);
  void (*step_finished)(void *, Status);
  void *environment;
} Callbacks;

typedef struct {
  Robot robot;
  char name[256];
  Logger logger;
  void *environment;
} Unit;

static Status refuse(Unit *unit, String message) {
  if (unit->logger) unit->logger(unit->environment, unit->name, ERROR, "logStatusError", "%s", message);
  return ERROR;
}

EXPORT String fmi2GetTypesPlatform(void) { return "default"; }
EXPORT String fmi2GetVersion(void) { return "2.0"; }
EXPORT Status fmi2SetDebugLogging(Component c, int on, size_t n, const String categories[]) {
  (void)c, (void)on, (void)n, (void)categories;
  return OK;
}

EXPORT Component fmi2Instantiate(String name, int type, String guid, String resources, const Callbacks *callbacks,
                                 int visible, int logging) {
  (void)resources, (void)visible, (void)logging;
  if (type != 1 || strcmp(guid, GUID) != 0) return NULL;
  Unit *unit = calloc(1, sizeof *unit);
  if (!unit) return NULL;
  strncpy(unit->name, name ? name : "", sizeof unit->name - 1);
  unit->logger = callbacks ? callbacks->logger : NULL;
  unit->environment = callbacks ? callbacks->environment : NULL;
  robot_reset(&unit->robot);
  return unit;
}

EXPORT void fmi2FreeInstance(Component c) { free(c); }

EXPORT Status fmi2SetupExperiment(Component c, int has_tolerance, double tolerance, double start, int has_stop,
                                  double stop) {
  (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
  ((Unit *)c)->robot.time = start;
  return OK;
}

EXPORT Status fmi2EnterInitializationMode(Component c) {
  (void)c;
  return OK;
}

EXPORT Status fmi2ExitInitializationMode(Component c) {
  Unit *unit = c;
  return robot_start(&unit->robot) ? refuse(unit, START_REFUSED) : OK;
}

EXPORT Status fmi2Terminate(Component c) {
  (void)c;
  return OK;
}

EXPORT Status fmi2Reset(Component c) {
  robot_reset(&((Unit *)c)->robot);
  return OK;
}

EXPORT Status fmi2GetReal(Component c, const Reference r[], size_t n, double value[]) {
  Unit *unit = c;
  if (!unit->robot.started) {
    Robot ready = unit->robot;
    if (!robot_start(&ready)) memcpy(unit->robot.value, ready.value, sizeof ready.value);
  }
  for (size_t i = 0; i < n; i++) {
    if (r[i] >= N_VALUES) return refuse(unit, "a value reference that no real variable has");
    value[i] = unit->robot.value[r[i]];
  }
  return OK;
}

EXPORT Status fmi2SetReal(Component c, const Reference r[], size_t n, const double value[]) {
  Unit *unit = c;
  for (size_t i = 0; i < n; i++) {
    if (r[i] >= N_VALUES || !robot_may_set((int)r[i], unit->robot.started))
      return refuse(unit, "a variable that cannot be set, or not any more");
    unit->robot.value[r[i]] = value[i];
  }
  return OK;
}

EXPORT Status fmi2GetInteger(Component c, const Reference r[], size_t n, int value[]) {
  for (size_t i = 0; i < n; i++) {
    if (r[i] != N_VALUES) return refuse(c, "a value reference that no integer variable has");
    value[i] = ((Unit *)c)->robot.configuration;
  }
  return OK;
}

EXPORT Status fmi2SetInteger(Component c, const Reference r[], size_t n, const int value[]) {
  for (size_t i = 0; i < n; i++) {
    if (r[i] != N_VALUES || ((Unit *)c)->robot.started) return refuse(c, "a configuration is chosen before the start");
    ((Unit *)c)->robot.configuration = value[i];
  }
  return OK;
}

EXPORT Status fmi2DoStep(Component c, double at, double step, int no_state_before) {
  (void)at, (void)no_state_before;
  return robot_advance(&((Unit *)c)->robot, step) ? refuse(c, LOST) : OK;
}

/* There are no variables of other types. */
#define NONE_OF(kind, type)                                                                     \
  EXPORT Status fmi2Get##kind(Component c, const Reference r[], size_t n, type value[]) {       \
    (void)r, (void)value;                                                                       \
    return n ? refuse(c, "there is no variable of this type") : OK;                             \
  }                                                                                             \
  EXPORT Status fmi2Set##kind(Component c, const Reference r[], size_t n, const type value[]) { \
    (void)r, (void)value;                                                                       \
    return n ? refuse(c, "there is no variable of this type") : OK;                             \
  }
NONE_OF(Boolean, int)
NONE_OF(String, String)

EXPORT Status fmi2GetFMUstate(Component c, void **state) {
  if (!*state) *state = malloc(sizeof(Robot));
  if (!*state) return refuse(c, "no memory is left for a state");
  memcpy(*state, &((Unit *)c)->robot, sizeof(Robot));
  return OK;
}

EXPORT Status fmi2SetFMUstate(Component c, void *state) {
  memcpy(&((Unit *)c)->robot, state, sizeof(Robot));
  return OK;
}

EXPORT Status fmi2FreeFMUstate(Component c, void **state) {
  (void)c;
  free(*state);
  *state = NULL;
  return OK;
}

EXPORT Status fmi2SerializedFMUstateSize(Component c, void *state, size_t *size) {
  (void)c, (void)state;
  *size = sizeof(Robot);
  return OK;
}

EXPORT Status fmi2SerializeFMUstate(Component c, void *state, char bytes[], size_t size) {
  if (size < sizeof(Robot)) return refuse(c, "too few bytes for a state");
  memcpy(bytes, state, sizeof(Robot));
  return OK;
}

EXPORT Status fmi2DeSerializeFMUstate(Component c, const char bytes[], size_t size, void **state) {
  if (size != sizeof(Robot)) return refuse(c, "these bytes are not of a state of this unit");
  if (!*state) *state = malloc(sizeof(Robot));
  if (!*state) return refuse(c, "no memory is left for a state");
  memcpy(*state, bytes, sizeof(Robot));
  return OK;
}

EXPORT Status fmi2GetDirectionalDerivative(Component c, const Reference unknown[], size_t n, const Reference known[],
                                           size_t m, const double by[], double value[]) {
  (void)unknown, (void)n, (void)known, (void)m, (void)by, (void)value;
  return refuse(c, "derivatives are not provided");
}

EXPORT Status fmi2SetRealInputDerivatives(Component c, const Reference r[], size_t n, const int order[],
                                          const double value[]) {
  (void)r, (void)n, (void)order, (void)value;
  return refuse(c, "inputs are held");
}

EXPORT Status fmi2GetRealOutputDerivatives(Component c, const Reference r[], size_t n, const int order[],
                                           double value[]) {
  (void)r, (void)n, (void)order, (void)value;
  return refuse(c, "derivatives are not provided");
}

EXPORT Status fmi2CancelStep(Component c) { return refuse(c, "steps are never pending"); }

#define NO_STATUS(kind, type)                                       \
  EXPORT Status fmi2Get##kind(Component c, int what, type *value) { \
    (void)c, (void)what, (void)value;                               \
    return DISCARD;                                                 \
  }
NO_STATUS(Status, Status)
NO_STATUS(RealStatus, double)
NO_STATUS(IntegerStatus, int)
NO_STATUS(BooleanStatus, int)
NO_STATUS(StringStatus, String)
