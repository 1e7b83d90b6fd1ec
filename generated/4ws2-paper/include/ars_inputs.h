/*
 * Plausibility checks of the measurements, and estimates that replace implausible ones.
 *
 * Speed, front angle and yaw rate are checked separately: availability, range, largest change in a sample, the largest yaw rate that
 * the grip of the road allows, and frozen values. An implausible signal is replaced by an estimate. The front angle follows from the yaw
 * rate by the steady turn of the linear vehicle. The yaw rate follows from the lateral acceleration, or from the front angle by that
 * steady turn. The speed decays slowly from its last plausible value. The lateral acceleration is optional. It is used once it has
 * agreed with the yaw rate in a turn, and then detects a frozen front angle, a yaw rate of the wrong sign and, in a turn, a speed
 * that is frozen or drifts.
 *
 * The offsets of yaw rate and lateral acceleration are learned from each other with a time constant, up to their bounds, and subtracted.
 * What both show alike on a straight is a side wind rather than an offset, and is learned slowly. In turns only the offset of the lateral
 * acceleration is learned, slowly. Without a lateral acceleration, a steady side wind cannot be told from an offset.
 *
 * Units are SI (m/s, rad, rad/s). Signs follow ISO 8855: angles and yaw rate are positive to the left.
 *
 * Map 4ws2-paper: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#ifndef ARS_INPUTS_H
#define ARS_INPUTS_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define ARS_INPUTS_BUILD 0x76CDF87Cu

/* Measurements of one sample. A value that is not available is NaN. */
typedef struct {
    float speed;                /* m/s, negative in reverse */
    float front_angle;          /* rad, at the road wheel */
    float yaw_rate;             /* rad/s */
    float rear_angle;           /* rad, achieved by the actuator; NaN where it is not measured */
    float friction;             /* estimated peak friction; NaN where unknown: the map's own is taken */
    float lateral_acceleration; /* m/s^2 at the centre of gravity; NaN: not measured */
    bool inhibit;               /* ESC or ABS is acting: the integrator holds */
} ars_measurement_t;

/* Calibration parameters. Call ars_inputs_parameters_valid() after each change. */
typedef struct {
    float speed_max;                    /* m/s, largest valid speed */
    float front_angle_max;              /* rad, largest valid front angle */
    float yaw_rate_max;                 /* rad/s, largest valid yaw rate */
    float rear_angle_max;               /* rad, largest valid rear angle */
    float friction_max;                 /* largest valid friction estimate */
    float speed_step;                   /* m/s, largest valid change of the speed per sample */
    float front_angle_step;             /* rad, largest valid change of the front angle per sample */
    float yaw_rate_step;                /* rad/s, largest valid change of the yaw rate per sample */
    float wheelbase;                    /* m, wheelbase of the linear car */
    float understeer_coefficient;       /* s^2/m, understeer coefficient of the linear car */
    float expected_share;               /* weight of the steady yaw rate in the expected yaw rate's filter */
    float yaw_rate_tolerance;           /* rad/s, allowed excess of the yaw rate over the road's limit */
    float lateral_acceleration_max;     /* m/s^2, largest valid lateral acceleration, and the limit of every road */
    float yaw_rate_frozen;              /* rad/s, yaw-rate deviation at which an unchanged signal counts as frozen */
    float speed_agreement;              /* m/s, rejected speed is accepted within this plus a quarter of its substitute */
    float yaw_rate_agreement;           /* rad/s, yaw-rate deviation in a turn that counts as agreement */
    float straight_yaw_rate;            /* rad/s, largest yaw rate from the front wheels on a straight */
    float yaw_rate_offset_max;          /* rad/s, largest learned offset of the yaw rate */
    float lateral_acceleration_offset_max;/* m/s^2, largest learned offset of the lateral acceleration */
    float yaw_rate_correction_share;    /* share of an offset or deviation that one sample corrects */
    float speed_fall;                   /* m/s, decrease of a lost speed per sample */
    float friction_recovery;            /* increase of a lost friction estimate per sample */
    uint16_t missing_samples_max;       /* missing samples minus twice the good ones until a signal is replaced */
    uint16_t recovery_samples;          /* good samples minus missing ones until a signal is used again */
} ars_inputs_parameters_t;

/* Source of the value of a signal. */
typedef enum {
    ARS_SIGNAL_MEASURED = 0,
    ARS_SIGNAL_LOST = 1,    /* missing or out of range for too long: replaced until it has been available for a while */
    ARS_SIGNAL_WRONG = 2    /* jumped, frozen or contradicted: replaced until it has agreed with the others in a turn for a while */
} ars_signal_source_t;

/* State of one signal. */
typedef struct {
    float value;         /* last plausible measurement, or the estimate that replaces it */
    uint16_t missing;    /* missing samples minus twice the complete ones; at most one above the limit */
    uint16_t good;       /* consecutive samples that confirm it while it is replaced, or contradict it while it is measured */
    ars_signal_source_t source;
} ars_signal_t;

/* Quality of a sample. */
typedef enum {
    ARS_QUALITY_GOOD = 0,
    ARS_QUALITY_REPLACED = 1, /* a signal is replaced by an estimate */
    ARS_QUALITY_MISSING = 2,  /* a signal is missing, for a short time so far */
    ARS_QUALITY_UNUSABLE = 3  /* neither front angle nor yaw rate is plausible */
} ars_quality_t;

/* State between two steps. Private. */
typedef struct {
    ars_signal_t speed;
    ars_signal_t front_angle;
    ars_signal_t yaw_rate;
    float expected_yaw_rate; /* rad/s, yaw rate of the linear vehicle with these steering angles */
    float least;             /* rad/s, smallest difference between yaw rate and expected_yaw_rate since the yaw rate last changed */
    float least_of_front;    /* rad/s, smallest such difference since the front angle last changed */
    float yaw_rate_offset;   /* rad/s, learned on straights */
    float lateral_acceleration_offset; /* m/s^2, learned in turns and on straights */
    float beyond_linear;     /* rad/s, correction of expected_yaw_rate by the lateral acceleration while both replace the yaw rate */
    float friction;          /* last estimate; moves to the value of an unknown road while none arrives */
    float lateral_acceleration; /* m/s^2, last measured value */
    float least_of_lateral;     /* rad/s, smallest difference between yaw rate and lateral acceleration / speed since the latter changed */
    uint16_t lateral_against;  /* samples in which the lateral acceleration contradicts the yaw rate, minus the others */
    bool lateral_is_wrong;     /* not used */
    bool lateral_is_known;   /* a lateral acceleration was measured at least once */
    bool lateral_is_proven;  /* the lateral acceleration agreed with the yaw rate in the last turn */
} ars_inputs_t;

/* Return whether every parameter is finite, in range and consistent with the others; false for NaN. */
bool ars_inputs_parameters_valid(const ars_inputs_parameters_t *parameters);

/*
 * Initialise. is_trusted: true accepts the first available sample at once; false requires recovery_samples good ones, as after a loss.
 */
void ars_inputs_init(ars_inputs_t *self, bool is_trusted);

/*
 * Check one sample. No pointer may be null, and parameters must be valid.
 *
 * measured:   may contain any number, NaN and infinity too.
 * rear_angle: rad, the last command, finite. It replaces a rear angle that is not measured.
 * checked:    receives the checked sample. Every field is finite; speed, angles and yaw rate are within their ranges, and an
 *             unknown friction is above that of every map.
 * Returns the quality of the sample.
 */
ars_quality_t ars_inputs_step(
    ars_inputs_t *self, const ars_inputs_parameters_t *parameters, const ars_measurement_t *measured, float rear_angle,
    ars_measurement_t *checked);

#ifdef __cplusplus
}
#endif

#endif /* ARS_INPUTS_H */
