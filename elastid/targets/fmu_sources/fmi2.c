/* What version 2.0 of the Functional Mock-up Interface for co-simulation has of its own. */
#define FMI_VERSION 2
#include "fmi.h"

typedef struct {
  Logger logger;
  void *(*allocate)(size_t, size_t);
  void (*release)(void *);
  void (*step_finished)(void *, Status);
  void *environment;
} Callbacks;

EXPORT String fmi2GetTypesPlatform(void) { return "default"; }

EXPORT Instance fmi2Instantiate(String name, int type, String guid, String resources, const Callbacks *callbacks,
                                int visible, int logging) {
  (void)resources, (void)visible, (void)logging;
  if (type != 1) return NULL;
  return instantiated(name, guid, callbacks ? callbacks->logger : NULL, callbacks ? callbacks->environment : NULL);
}

EXPORT Status fmi2SetupExperiment(Instance c, int has_tolerance, double tolerance, double start, int has_stop,
                                  double stop) {
  (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
  ((Unit *)c)->robot.time = start;
  return OK;
}

EXPORT Status fmi2EnterInitializationMode(Instance c) {
  (void)c;
  return OK;
}

EXPORT Status fmi2GetReal(Instance c, const Reference r[], size_t n, double value[]) {
  return get_values(c, r, n, value);
}
EXPORT Status fmi2SetReal(Instance c, const Reference r[], size_t n, const double value[]) {
  return set_values(c, r, n, value);
}
EXPORT Status fmi2GetInteger(Instance c, const Reference r[], size_t n, int value[]) {
  return get_configuration(c, r, n, value);
}
EXPORT Status fmi2SetInteger(Instance c, const Reference r[], size_t n, const int value[]) {
  return set_configuration(c, r, n, value);
}

EXPORT Status fmi2DoStep(Instance c, double at, double step, int no_state_before) {
  (void)at, (void)no_state_before;
  return robot_advance(&((Unit *)c)->robot, step) ? refuse(c, LOST) : OK;
}

/* There are no variables of other types. */
#define NONE_OF(kind, type)                                                                    \
  EXPORT Status fmi2Get##kind(Instance c, const Reference r[], size_t n, type value[]) {       \
    (void)r, (void)value;                                                                      \
    return n ? refuse(c, "there is no variable of this type") : OK;                            \
  }                                                                                            \
  EXPORT Status fmi2Set##kind(Instance c, const Reference r[], size_t n, const type value[]) { \
    (void)r, (void)value;                                                                      \
    return n ? refuse(c, "there is no variable of this type") : OK;                            \
  }
NONE_OF(Boolean, int)
NONE_OF(String, String)

EXPORT Status fmi2GetDirectionalDerivative(Instance c, const Reference unknown[], size_t n, const Reference known[],
                                           size_t m, const double by[], double value[]) {
  (void)unknown, (void)n, (void)known, (void)m, (void)by, (void)value;
  return refuse(c, "derivatives are not provided");
}

EXPORT Status fmi2SetRealInputDerivatives(Instance c, const Reference r[], size_t n, const int order[],
                                          const double value[]) {
  (void)r, (void)n, (void)order, (void)value;
  return refuse(c, "inputs are held");
}

EXPORT Status fmi2GetRealOutputDerivatives(Instance c, const Reference r[], size_t n, const int order[],
                                           double value[]) {
  (void)r, (void)n, (void)order, (void)value;
  return refuse(c, "derivatives are not provided");
}

EXPORT Status fmi2CancelStep(Instance c) { return refuse(c, "steps are never pending"); }

#define NO_STATUS(kind, type)                                      \
  EXPORT Status fmi2Get##kind(Instance c, int what, type *value) { \
    (void)c, (void)what, (void)value;                              \
    return DISCARD;                                                \
  }
NO_STATUS(Status, Status)
NO_STATUS(RealStatus, double)
NO_STATUS(IntegerStatus, int)
NO_STATUS(BooleanStatus, int)
NO_STATUS(StringStatus, String)
