/* C interface of kband. Made by cbindgen from bindings/c/src; do not edit.
 *
 * Every function that can fail returns a kband_code; kband_error() then has the cause with the
 * value and the accepted range, for the calling thread. A handle is used by one thread at a time.
 * It is live, from its kband_..._new or _parse until it is freed once, or null. Any other pointer is
 * null, or to what the call reads or writes.
 * Symbols: k is normal gravity over b w^2, with the amplitude b of the track normal to itself and
 * the drive's angular frequency w; R is the restitution of a part. Phases are in rad of the drive,
 * speeds of the map in units of b w.
 */

#ifndef KBAND_H
#define KBAND_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/**
 * Samples a second.
 */
#define KBAND_SAMPLE_RATE 20000

/**
 * Slices of the plan in each drive cycle.
 */
#define KBAND_PLAN_SLICES 16

/**
 * What came of a call. Numbers never change.
 */
typedef enum {
  /**
   * Done.
   */
  KBAND_CODE_OK = 0,
  /**
   * A pointer is null.
   */
  KBAND_CODE_NULL = 1,
  /**
   * A value is out of range.
   */
  KBAND_CODE_OUT_OF_RANGE = 2,
  /**
   * The text is no scene.
   */
  KBAND_CODE_SCENE = 3,
  /**
   * There is no such band or plan.
   */
  KBAND_CODE_NONE = 4,
  /**
   * An error of kband: the handle of this call is only good to be freed.
   */
  KBAND_CODE_PANIC = 5,
} kband_code;

/**
 * What a controller is to reach.
 */
typedef enum {
  /**
   * Gear of the order `value`, 1..8.
   */
  KBAND_TARGET_GEAR = 0,
  /**
   * Lock of the order `value`, 1..8.
   */
  KBAND_TARGET_LOCKED = 1,
  /**
   * k = `value`, 0.02..10.
   */
  KBAND_TARGET_K = 2,
  /**
   * Amplitude `value` in mm, 0..100.
   */
  KBAND_TARGET_AMPLITUDE = 3,
  /**
   * Speed `value` in mm/s.
   */
  KBAND_TARGET_SPEED = 4,
} kband_target;

/**
 * The firmware's controller.
 */
typedef struct kband_controller kband_controller;

/**
 * The simulated feeder of a scene: a converter code for each output.
 */
typedef struct kband_plant kband_plant;

/**
 * A scene: one feeder, its target, and its disturbances over time.
 */
typedef struct kband_scene kband_scene;

/**
 * The firmware's signal path: drive phase, demodulation, impacts.
 */
typedef struct kband_signal kband_signal;

/**
 * Inputs of the board in a drive cycle.
 */
typedef struct {
  /**
   * The enable input.
   */
  bool enable;
  /**
   * The over-temperature input.
   */
  bool over_temperature;
  /**
   * Whether the link received a frame since the last cycle.
   */
  bool link_heard;
  /**
   * Whether the stack came close to its end.
   */
  bool stack_low;
  /**
   * The over-current input.
   */
  bool over_current;
  /**
   * Whether the supply is below what the chip needs.
   */
  bool supply_low;
  /**
   * Whether the clock is another than the crystal's.
   */
  bool clock_failed;
} kband_inputs;

/**
 * Answer of the signal path to a sample.
 */
typedef struct {
  /**
   * Output of the drive until the next sample, -1..1.
   */
  float output;
  /**
   * Advance of the drive's phase in 2^-32 turns.
   */
  uint32_t step;
  /**
   * Whether a drive cycle ended: `kband_controller_cycle` is due.
   */
  bool wrapped;
} kband_output;

/**
 * What the controller reports of a drive cycle.
 */
typedef struct {
  /**
   * Number of the cycle.
   */
  uint32_t cycle;
  /**
   * Measured amplitude (b) in m.
   */
  float amplitude;
  /**
   * Reference of the amplitude in m.
   */
  float reference;
  /**
   * Amplitude of the target in m; 0 where it has none.
   */
  float setpoint;
  /**
   * Measured k.
   */
  float k;
  /**
   * Estimated share of time in gear, 0..1.
   */
  float in_gear;
  /**
   * Its standard error; infinite for a lower bound.
   */
  float in_gear_error;
  /**
   * Amplitude of the output, 0..1.
   */
  float output;
  /**
   * Number of the controller's state (`kband_state_name`).
   */
  uint8_t state;
  /**
   * Number of the fault that stopped the drive (`kband_fault_name`); 0 without one.
   */
  uint8_t fault;
} kband_report;

/**
 * Band of k in which a whole lot has the lock.
 */
typedef struct {
  /**
   * Lowest k: there the lock doubles.
   */
  double low;
  /**
   * Highest k: there the lock is born.
   */
  double high;
  /**
   * k with the largest margin.
   */
  double setpoint;
} kband_band_of_lot;

/**
 * A lot of parts and what may be chosen for it.
 */
typedef struct {
  /**
   * Lowest mean restitution, 0..1.
   */
  double restitution_low;
  /**
   * Highest mean restitution, 0..1.
   */
  double restitution_high;
  /**
   * Standard deviation of the restitution from impact to impact, 0..0.3.
   */
  float scatter;
  /**
   * Largest relative error of the amplitude, 0..0.2.
   */
  float amplitude_error;
  /**
   * Drive periods in a flight, 1..100.
   */
  uint32_t order;
  /**
   * Lowest k that may be chosen, 0.005..4.
   */
  float k_low;
  /**
   * Highest k that may be chosen, 0.005..4.
   */
  float k_high;
  /**
   * Largest amplitude of a second tone over the first, 0..0.5; below 0.01 there is none.
   */
  float max_second_tone;
  /**
   * The same of a third tone; without a second tone there is none.
   */
  float max_third_tone;
} kband_gear_lot;

/**
 * The k and the tones with the largest share of time in gear.
 */
typedef struct {
  /**
   * k of the first tone.
   */
  float k;
  /**
   * Amplitude of the second tone over the first.
   */
  float second_tone;
  /**
   * Angle of the second tone in rad.
   */
  float second_angle;
  /**
   * Amplitude of the third tone over the first.
   */
  float third_tone;
  /**
   * Angle of the third tone in rad.
   */
  float third_angle;
  /**
   * Lowest k whose share is within 0.02 of the best.
   */
  float band_low;
  /**
   * Highest k whose share is within 0.02 of the best.
   */
  float band_high;
  /**
   * Predicted share of time in gear, mean over the lot, 0..1.
   */
  float share;
} kband_gear_choice;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * Version of kband, as "0.1.0".
 */
const char *kband_version(void);

/**
 * Text of a code; of another number "no code of kband".
 */
const char *kband_code_text(int32_t code);

/**
 * Copies why the last failed call of this thread failed, with a zero at the end, into `size`
 * bytes; it is cut to fit. Returns its length without the zero; 0 where none failed.
 *
 * # Safety
 * `buffer` has `size` bytes, or is null with `size` 0.
 */
size_t kband_error(char *buffer, size_t size);

/**
 * A scene from its text in TOML, of `length` bytes. Free it with `kband_scene_free`.
 *
 * # Safety
 * `text` has `length` bytes; `scene` may be written to.
 */
kband_code kband_scene_parse(const char *text, size_t length, kband_scene **scene);

/**
 * Frees a scene; null is ignored.
 */
void kband_scene_free(kband_scene *scene);

/**
 * Duration of a scene in s.
 */
kband_code kband_scene_duration(const kband_scene *scene, double *duration);

/**
 * The plant of a scene at time 0: parts at rest, drive off. Free it with `kband_plant_free`.
 */
kband_code kband_plant_new(const kband_scene *scene, kband_plant **plant);

/**
 * Frees a plant; null is ignored.
 */
void kband_plant_free(kband_plant *plant);

/**
 * Converter codes of the accelerometer and of the current sensor at the next sample; `current` may
 * be null.
 */
kband_code kband_plant_sample(kband_plant *plant, uint16_t *accelerometer, uint16_t *current);

/**
 * Holds an output (-1..1) until the next sample, while the drive's phase advances by `step`.
 */
kband_code kband_plant_hold(kband_plant *plant, float output, uint32_t step);

/**
 * Inputs of the board at this time of the scene.
 */
kband_code kband_plant_inputs(const kband_plant *plant, kband_inputs *inputs);

/**
 * Mean displacement of the parts along the track in m.
 */
kband_code kband_plant_displacement(const kband_plant *plant, double *displacement);

/**
 * The signal path with the settings of a scene. Free it with `kband_signal_free`.
 */
kband_code kband_signal_new(const kband_scene *scene, kband_signal **signal);

/**
 * Frees a signal path; null is ignored.
 */
void kband_signal_free(kband_signal *signal);

/**
 * Takes the converter codes of a sample; gives the output until the next. It allocates nothing.
 */
kband_code kband_signal_sample(kband_signal *signal,
                               uint16_t accelerometer,
                               uint16_t current,
                               kband_output *output);

/**
 * The controller with the settings and the target of a scene. Free it with
 * `kband_controller_free`.
 */
kband_code kband_controller_new(const kband_scene *scene, kband_controller **controller);

/**
 * Frees a controller; null is ignored.
 */
void kband_controller_free(kband_controller *controller);

/**
 * Ends a drive cycle: takes the measurements of the signal path and the inputs of the board, and
 * gives the signal path its next command. `report` may be null. It allocates nothing.
 */
kband_code kband_controller_cycle(kband_controller *controller,
                                  kband_signal *signal,
                                  const kband_inputs *inputs,
                                  kband_report *report);

/**
 * Computes one slice of what the controller plans, in the time left of a drive cycle; at most
 * `KBAND_PLAN_SLICES` a cycle. `more` tells whether more remain. It allocates nothing.
 */
kband_code kband_controller_plan(kband_controller *controller, bool *more);

/**
 * Asks for another target: `kind` is a `kband_target`, `value` what it says of it.
 */
kband_code kband_controller_set_target(kband_controller *controller, int32_t kind, float value);

/**
 * Name of a state, by its number; "unknown" for another number.
 */
const char *kband_state_name(uint8_t number);

/**
 * Name of a fault, by its number; "none" for another number.
 */
const char *kband_fault_name(uint8_t number);

/**
 * The first impact after each launch: phase (rad, 0..2 pi) and speed (units of b w) just after it.
 *
 * phase: -1.3e7..1.3e7 rad; speed: 0..1000 b w; k: 0.001..1000; restitution: 0..1. `next_phase`
 * and
 * `next_speed` may be the arrays `phase` and `speed`. Launches before a refused one may be done.
 *
 * # Safety
 * Each array has `count` elements.
 */
kband_code kband_impacts(const double *phase,
                         const double *speed,
                         const double *k,
                         const double *restitution,
                         size_t count,
                         double *next_phase,
                         double *next_speed);

/**
 * The band of k in which parts of restitution `low`..`high` (0..1) have the period-1 lock of an
 * order, 1..100 drive periods a flight. `KBAND_CODE_NONE` where they have no band in common.
 */
kband_code kband_band(double low, double high, uint32_t order, kband_band_of_lot *band);

/**
 * Plans gear for a lot, as the board does; it takes some 0.1 s. `KBAND_CODE_NONE` where no k that
 * may be chosen is settled on.
 */
kband_code kband_gear_plan(const kband_gear_lot *lot, kband_gear_choice *choice);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* KBAND_H */
