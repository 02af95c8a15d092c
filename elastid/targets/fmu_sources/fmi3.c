/* What version 3.0 of the Functional Mock-up Interface for co-simulation has of its own. */
#define FMI_VERSION 3
#include "fmi.h"

EXPORT Instance fmi3InstantiateCoSimulation(String name, String token, String resources, bool visible, bool logging,
                                            bool events, bool early, const Reference required[], size_t n,
                                            void *environment, Logger logger, void *update) {
  (void)resources, (void)visible, (void)logging, (void)events, (void)early, (void)required, (void)n;
  (void)update;
  return instantiated(name, token, logger, environment);
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

EXPORT Status fmi3EnterInitializationMode(Instance c, bool has_tolerance, double tolerance, double start, bool has_stop,
                                          double stop) {
  (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
  ((Unit *)c)->robot.time = start;
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

EXPORT Status fmi3GetFloat64(Instance c, const Reference r[], size_t n, double value[], size_t n_values) {
  (void)n_values;
  return get_values(c, r, n, value);
}
EXPORT Status fmi3SetFloat64(Instance c, const Reference r[], size_t n, const double value[], size_t n_values) {
  (void)n_values;
  return set_values(c, r, n, value);
}
EXPORT Status fmi3GetInt32(Instance c, const Reference r[], size_t n, int32_t value[], size_t n_values) {
  (void)n_values;
  return get_configuration(c, r, n, value);
}
EXPORT Status fmi3SetInt32(Instance c, const Reference r[], size_t n, const int32_t value[], size_t n_values) {
  (void)n_values;
  return set_configuration(c, r, n, value);
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
