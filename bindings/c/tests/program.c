/* Every function of the C interface, used as a program would use it. Argument: a scene file. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "kband.h"

#define CHECK(condition)                                                                 \
    do {                                                                                 \
        if (!(condition)) {                                                              \
            char why[1024];                                                              \
            kband_error(why, sizeof why);                                                \
            fprintf(stderr, "%s:%d: %s (%s)\n", __FILE__, __LINE__, #condition, why);    \
            exit(1);                                                                     \
        }                                                                                \
    } while (0)

static char *read_file(const char *path, size_t *length) {
    FILE *file = fopen(path, "rb");
    CHECK(file != NULL);
    char *text = malloc(1 << 20);
    CHECK(text != NULL);
    *length = fread(text, 1, 1 << 20, file);
    fclose(file);
    return text;
}

static void map_and_regimes(void) {
    double phase[300], speed[300], k[300], restitution[300];
    for (int n = 0; n < 300; n++) {
        phase[n] = 0.02 * n;
        speed[n] = 0.01 * n;
        k[n] = 0.43;
        restitution[n] = 0.2;
    }
    CHECK(kband_impacts(phase, speed, k, restitution, 300, phase, speed) == KBAND_CODE_OK);
    for (int n = 0; n < 300; n++)
        CHECK(phase[n] >= 0 && phase[n] < 6.2832 && speed[n] >= 0 && isfinite(speed[n]));
    restitution[299] = 1.5;
    CHECK(kband_impacts(phase, speed, k, restitution, 300, phase, speed) == KBAND_CODE_OUT_OF_RANGE);
    char why[64];
    CHECK(kband_error(why, sizeof why) > 0);
    CHECK(strcmp(why, "restitution[299] = 1.5 is refused; accepted: 0..1") == 0);
    char cut[5] = "????";
    CHECK(kband_error(cut, 4) == strlen(why) && strcmp(cut, "res") == 0);
    CHECK(kband_impacts(NULL, speed, k, restitution, 1, phase, speed) == KBAND_CODE_NULL);
    CHECK(kband_impacts(NULL, NULL, NULL, NULL, 0, NULL, NULL) == KBAND_CODE_OK);

    kband_band_of_lot band;
    CHECK(kband_band(0.18, 0.22, 1, &band) == KBAND_CODE_OK);
    CHECK(band.low < band.setpoint && band.setpoint < band.high);
    CHECK(kband_band(0.1, 0.9, 1, &band) == KBAND_CODE_NONE);
    CHECK(kband_band(0.2, 0.1, 1, &band) == KBAND_CODE_OUT_OF_RANGE);
    CHECK(kband_band(0.2, 0.2, 1, NULL) == KBAND_CODE_NULL);

    kband_gear_lot lot = {.restitution_low = 0.28, .restitution_high = 0.32, .scatter = 0.05f,
                          .amplitude_error = 0.02f, .order = 1, .k_low = 0.1f, .k_high = 1.0f};
    kband_gear_choice choice;
    CHECK(kband_gear_plan(&lot, &choice) == KBAND_CODE_OK);
    CHECK(choice.k > 0.4f && choice.k < 0.5f && choice.share > 0.7f);
    lot.scatter = 0.5f;
    CHECK(kband_gear_plan(&lot, &choice) == KBAND_CODE_OUT_OF_RANGE);
    CHECK(kband_gear_plan(NULL, &choice) == KBAND_CODE_NULL);
}

static void closed_loop(const char *path, int seconds) {
    size_t length;
    char *text = read_file(path, &length);
    kband_scene *scene = NULL;
    kband_plant *plant = NULL;
    kband_signal *signal = NULL;
    kband_controller *controller = NULL;
    CHECK(kband_scene_parse("k = ", 4, &scene) == KBAND_CODE_SCENE && scene == NULL);
    CHECK(kband_scene_parse(NULL, 0, &scene) == KBAND_CODE_NULL);
    CHECK(kband_scene_parse(text, length, NULL) == KBAND_CODE_NULL);
    CHECK(kband_scene_parse(text, length, &scene) == KBAND_CODE_OK);
    free(text);
    double duration;
    CHECK(kband_scene_duration(scene, &duration) == KBAND_CODE_OK && duration == 10);
    CHECK(kband_plant_new(scene, &plant) == KBAND_CODE_OK);
    CHECK(kband_signal_new(scene, &signal) == KBAND_CODE_OK);
    CHECK(kband_controller_new(scene, &controller) == KBAND_CODE_OK);
    CHECK(kband_plant_new(NULL, &plant) == KBAND_CODE_NULL);
    kband_scene_free(scene);

    kband_report report;
    memset(&report, 0, sizeof report);
    for (int n = 0; n < seconds * KBAND_SAMPLE_RATE; n++) {
        uint16_t code, current;
        kband_output output;
        CHECK(kband_plant_sample(plant, &code, &current) == KBAND_CODE_OK);
        CHECK(kband_signal_sample(signal, code, current, &output) == KBAND_CODE_OK);
        CHECK(kband_plant_hold(plant, output.output, output.step) == KBAND_CODE_OK);
        if (output.wrapped) {
            kband_inputs inputs;
            CHECK(kband_plant_inputs(plant, &inputs) == KBAND_CODE_OK && inputs.enable);
            CHECK(kband_controller_cycle(controller, signal, &inputs, &report) == KBAND_CODE_OK);
            bool more = true;
            for (int slice = 0; slice < KBAND_PLAN_SLICES && more; slice++)
                CHECK(kband_controller_plan(controller, &more) == KBAND_CODE_OK);
        }
    }
    double displacement;
    CHECK(kband_plant_displacement(plant, &displacement) == KBAND_CODE_OK);
    CHECK(report.fault == 0 && report.amplitude > 1e-4f && displacement > 0);
    printf("%s after %u cycles: amplitude %.4f mm, k %.4f, fault %s\n", kband_state_name(report.state),
           report.cycle, 1e3 * report.amplitude, report.k, kband_fault_name(report.fault));

    CHECK(kband_plant_hold(plant, 1.5f, 0) == KBAND_CODE_OUT_OF_RANGE);
    CHECK(kband_plant_hold(plant, NAN, 0) == KBAND_CODE_OUT_OF_RANGE);
    CHECK(kband_controller_set_target(controller, KBAND_TARGET_K, 0.4f) == KBAND_CODE_OK);
    CHECK(kband_controller_set_target(controller, KBAND_TARGET_GEAR, 1.5f) == KBAND_CODE_OUT_OF_RANGE);
    CHECK(kband_controller_set_target(controller, KBAND_TARGET_GEAR, 200) == KBAND_CODE_OUT_OF_RANGE);
    CHECK(kband_controller_set_target(controller, 77, 1) == KBAND_CODE_OUT_OF_RANGE);
    CHECK(kband_controller_set_target(controller, KBAND_TARGET_K, NAN) == KBAND_CODE_OUT_OF_RANGE);
    CHECK(kband_controller_cycle(controller, NULL, NULL, NULL) == KBAND_CODE_NULL);
    CHECK(kband_signal_sample(signal, 0, 0, NULL) == KBAND_CODE_NULL);
    kband_plant_free(plant);
    kband_signal_free(signal);
    kband_controller_free(controller);
    kband_plant_free(NULL);
}

int main(int count, char **arguments) {
    CHECK(count == 3);
    CHECK(strcmp(kband_code_text(KBAND_CODE_PANIC), "an error of kband; report it") == 0);
    CHECK(strcmp(kband_code_text(77), "no code of kband") == 0);
    CHECK(strlen(kband_version()) >= 5);
    map_and_regimes();
    closed_loop(arguments[1], atoi(arguments[2]));
    return 0;
}
