/*
 * Monitoring of the inputs: which measurement is believed, and what stands for one that is not.
 *
 * Speed, front angle and yaw rate are judged one by one: is it there and in its range, could the car move so far in a sample, is the
 * yaw rate one that the road can give, and does it still change? What is not believed is replaced from the others: the front angle from
 * the yaw rate by the steady turn of the linear car; the yaw rate from the lateral acceleration, or from the front angle by that turn.
 * The speed falls slowly from the last one. The lateral acceleration is optional. It is used once it has agreed with the yaw rate in a turn,
 * and tells a front angle that froze, a yaw rate of the wrong sign and, in a turn, a speed that froze or drifted.
 *
 * On a straight the offset of the yaw rate is learned, with a time constant and up to a bound, and subtracted from then on. A steady side
 * wind looks like an offset where there is no lateral acceleration.
 *
 * Units are SI (m/s, rad, rad/s). Signs follow ISO 8855: angles and yaw rate are positive to the left.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#ifndef ARS_INPUTS_H
#define ARS_INPUTS_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define ARS_INPUTS_BUILD 0x3CA513E9u

/* One sample of what the vehicle measures. */
typedef struct {
    float speed;                /* m/s, negative in reverse */
    float front_angle;          /* rad, at the road wheel */
    float yaw_rate;             /* rad/s */
    float rear_angle;           /* rad, achieved by the actuator; NaN where it is not measured */
    float friction;             /* estimated peak friction; NaN where unknown: the map's own is taken */
    float lateral_acceleration; /* m/s^2 at the centre of gravity; NaN: not measured */
    bool inhibit;               /* ESC or ABS is acting: the integrator holds */
} ars_measurement_t;

/* Everything that calibration may change. Ask ars_inputs_parameters_valid() after each change. */
typedef struct {
    float speed_max;                    /* m/s, range */
    float front_angle_max;              /* rad, range */
    float yaw_rate_max;                 /* rad/s, range */
    float rear_angle_max;               /* rad, range */
    float friction_max;                 /* range */
    float speed_step;                   /* m/s at most in a sample */
    float front_angle_step;             /* rad at most in a sample */
    float yaw_rate_step;                /* rad/s at most in a sample */
    float wheelbase;                    /* m, of the linear car */
    float understeer_coefficient;       /* s^2/m: of the linear car */
    float expected_share;               /* share of its way to the steady turn that the yaw rate goes in a sample */
    float yaw_rate_tolerance;           /* rad/s beyond what the road explains */
    float lateral_acceleration_max;     /* m/s^2 that no road allows */
    float yaw_rate_frozen;              /* rad/s that yaw rate and front angle may move apart while one of them stays to the bit */
    float speed_agreement;              /* m/s, beyond a quarter of what stands for it, within which a speed that was wrong counts again */
    float yaw_rate_agreement;           /* rad/s, within which an angle or a yaw rate that was wrong does, in a turn of twice as much */
    float straight_yaw_rate;            /* rad/s that the front wheels make at most on a straight */
    float yaw_rate_offset_max;          /* rad/s that is learned at most */
    float yaw_rate_correction_share;    /* share of what is left of a correction of the yaw rate, in a sample */
    float speed_fall;                   /* m/s that a lost speed falls in a sample */
    float friction_recovery;            /* that a lost estimate rises in a sample */
    uint16_t missing_samples_max;       /* missing samples less others of a signal, before it is replaced */
    uint16_t recovery_samples;          /* in a row that end it */
} ars_inputs_parameters_t;

/* Where the value of a signal comes from. */
typedef enum {
    ARS_SIGNAL_MEASURED = 0,
    ARS_SIGNAL_LOST = 1,    /* absent, out of range or impossible too often: replaced until it has been there for a while */
    ARS_SIGNAL_WRONG = 2    /* it jumped or froze: replaced until it has agreed with the others in a turn for a while */
} ars_signal_source_t;

/* One signal. */
typedef struct {
    float value;         /* last measurement that was believed, or what stands for it */
    uint16_t missing;    /* samples without it less samples in which no signal is missing, at most one above the limit */
    uint16_t good;       /* samples in a row that speak for it while it is replaced, against it while it is measured */
    ars_signal_source_t source;
} ars_signal_t;

/* What a sample is worth. */
typedef enum {
    ARS_QUALITY_GOOD = 0,
    ARS_QUALITY_REPLACED = 1, /* a signal stands for another */
    ARS_QUALITY_MISSING = 2,  /* a signal is missing, for a short time so far */
    ARS_QUALITY_UNUSABLE = 3  /* neither front angle nor yaw rate is believed */
} ars_quality_t;

/* Memory between two steps. Private. */
typedef struct {
    ars_signal_t speed;
    ars_signal_t front_angle;
    ars_signal_t yaw_rate;
    float expected_yaw_rate; /* rad/s, of the linear car with these angles */
    float least;             /* rad/s, the least difference between yaw rate and expected_yaw_rate since the yaw rate changed last */
    float least_of_front;    /* rad/s, the same since the front angle changed last */
    float yaw_rate_offset;   /* rad/s, learned on straights */
    float beyond_linear;     /* rad/s, of the lateral acceleration's turn beyond that of the linear car, while that stands for a yaw rate */
    float friction;          /* last estimate, on its way to none since there was one */
    bool lateral_is_known;   /* a lateral acceleration has been measured */
    bool lateral_is_proven;  /* the lateral acceleration agreed with the yaw rate in the last turn */
} ars_inputs_t;

/* Whether every parameter is finite, in range and consistent with the others. ars_inputs_step() relies on it. */
bool ars_inputs_parameters_valid(const ars_inputs_parameters_t *parameters);

/* Start. is_trusted: the first sample is believed at once; false: not before as many as end a loss. */
void ars_inputs_init(ars_inputs_t *self, bool is_trusted);

/*
 * One sample: what is believed of it.
 *
 * measured: may hold any number. rear_angle: rad, last command; it stands for the rear angle where that is not measured.
 * believed: every field is finite, speed, angles and yaw rate lie in their ranges, and friction is beyond any map's where unknown.
 */
ars_quality_t ars_inputs_step(
    ars_inputs_t *self, const ars_inputs_parameters_t *parameters, const ars_measurement_t *measured, float rear_angle,
    ars_measurement_t *believed);

#ifdef __cplusplus
}
#endif

#endif /* ARS_INPUTS_H */
