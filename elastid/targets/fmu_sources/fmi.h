/* The functions that versions 2.0 and 3.0 of the Functional Mock-up Interface share; FMI_VERSION says whose they are. */
#include <stdbool.h>
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
typedef enum { OK, WARNING, DISCARD, ERROR, FATAL, PENDING } Status;

#if FMI_VERSION == 2
#define FMI(name) fmi2##name
#define FMI_STATE(verb, of) fmi2##verb##FMUstate##of
#define DESERIALIZE fmi2DeSerializeFMUstate
#define REAL_VARIABLE "real variable"
#define INTEGER_VARIABLE "integer variable"
typedef int Flag;
typedef char Byte;
typedef void (*Logger)(void *, String, Status, String, String, ...);
#define LOGGED(unit) (unit)->environment, (unit)->name, ERROR, "logStatusError", "%s"
#else
#define FMI(name) fmi3##name
#define FMI_STATE(verb, of) fmi3##verb##FMUState##of
#define DESERIALIZE fmi3DeserializeFMUState
#define REAL_VARIABLE "variable of type Float64"
#define INTEGER_VARIABLE "variable of type Int32"
typedef bool Flag;
typedef uint8_t Byte;
typedef void (*Logger)(void *, Status, String, String);
#define LOGGED(unit) (unit)->environment, ERROR, "logStatusError"
#endif

typedef struct {
  Robot robot;
  char name[256];
  Logger logger;
  void *environment;
} Unit;

static Status refuse(Unit *unit, String message) {
  if (unit && unit->logger) unit->logger(LOGGED(unit), message);
  return ERROR;
}

static Unit *instantiated(String name, String token, Logger logger, void *environment) {
  if (strcmp(token, GUID) != 0) return NULL;
  Unit *unit = calloc(1, sizeof *unit);
  if (!unit) return NULL;
  strncpy(unit->name, name ? name : "", sizeof unit->name - 1);
  unit->logger = logger;
  unit->environment = environment;
  robot_reset(&unit->robot);
  return unit;
}

static Status get_values(Unit *unit, const Reference r[], size_t n, double value[]) {
  if (!unit->robot.started) {
    Robot ready = unit->robot;
    if (!robot_start(&ready)) memcpy(unit->robot.value, ready.value, sizeof ready.value);
  }
  for (size_t i = 0; i < n; i++) {
    if (r[i] >= N_VALUES) return refuse(unit, "the value reference belongs to no " REAL_VARIABLE);
    value[i] = unit->robot.value[r[i]];
  }
  return OK;
}

static Status set_values(Unit *unit, const Reference r[], size_t n, const double value[]) {
  for (size_t i = 0; i < n; i++) {
    if (r[i] >= N_VALUES || !robot_may_set((int)r[i], unit->robot.started))
      return refuse(unit, "the variable is read-only, or can be set only before the start");
    unit->robot.value[r[i]] = value[i];
  }
  return OK;
}

static Status get_configuration(Unit *unit, const Reference r[], size_t n, int32_t value[]) {
  for (size_t i = 0; i < n; i++) {
    if (r[i] != N_VALUES) return refuse(unit, "the value reference belongs to no " INTEGER_VARIABLE);
    value[i] = unit->robot.configuration;
  }
  return OK;
}

static Status set_configuration(Unit *unit, const Reference r[], size_t n, const int32_t value[]) {
  for (size_t i = 0; i < n; i++) {
    if (r[i] != N_VALUES || unit->robot.started) return refuse(unit, "the configuration must be set before the start");
    unit->robot.configuration = value[i];
  }
  return OK;
}

EXPORT String FMI(GetVersion)(void) { return FMI_VERSION == 2 ? "2.0" : "3.0"; }
EXPORT Status FMI(SetDebugLogging)(Instance c, Flag on, size_t n, const String categories[]) {
  (void)c, (void)on, (void)n, (void)categories;
  return OK;
}

EXPORT void FMI(FreeInstance)(Instance c) { free(c); }

EXPORT Status FMI(ExitInitializationMode)(Instance c) {
  return robot_start(&((Unit *)c)->robot) ? refuse(c, START_REFUSED) : OK;
}

EXPORT Status FMI(Terminate)(Instance c) {
  (void)c;
  return OK;
}

EXPORT Status FMI(Reset)(Instance c) {
  robot_reset(&((Unit *)c)->robot);
  return OK;
}

EXPORT Status FMI_STATE(Get, )(Instance c, void **state) {
  if (!*state) *state = malloc(sizeof(Robot));
  if (!*state) return refuse(c, "no memory is left for a state");
  memcpy(*state, &((Unit *)c)->robot, sizeof(Robot));
  return OK;
}

EXPORT Status FMI_STATE(Set, )(Instance c, void *state) {
  memcpy(&((Unit *)c)->robot, state, sizeof(Robot));
  return OK;
}

EXPORT Status FMI_STATE(Free, )(Instance c, void **state) {
  (void)c;
  free(*state);
  *state = NULL;
  return OK;
}

EXPORT Status FMI_STATE(Serialized, Size)(Instance c, void *state, size_t *size) {
  (void)c, (void)state;
  *size = sizeof(Robot);
  return OK;
}

EXPORT Status FMI_STATE(Serialize, )(Instance c, void *state, Byte bytes[], size_t size) {
  if (size < sizeof(Robot)) return refuse(c, "too few bytes for a state");
  memcpy(bytes, state, sizeof(Robot));
  return OK;
}

EXPORT Status DESERIALIZE(Instance c, const Byte bytes[], size_t size, void **state) {
  if (size != sizeof(Robot)) return refuse(c, "the serialized state has the wrong size");
  if (!*state) *state = malloc(sizeof(Robot));
  if (!*state) return refuse(c, "no memory is left for a state");
  memcpy(*state, bytes, sizeof(Robot));
  return OK;
}
