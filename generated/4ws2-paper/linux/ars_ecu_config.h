/*
 * Configuration of the Linux program (ars_ecu.c) and of its XCP slave (ars_xcp.c) for this build.
 *
 * The other files in this folder are the same in every build.
 *
 * Map 4ws2-paper: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#ifndef ARS_ECU_CONFIG_H
#define ARS_ECU_CONFIG_H

#include "ars_can.h"
#include "ars_controller.h"
#include "ars_map.h"
#include "ars_task.h"

#define ARS_ECU_CONFIG_BUILD 0x76CDF87Cu

#if ARS_CAN_BUILD != ARS_ECU_CONFIG_BUILD
#error "ars_can.h and ars_ecu_config.h come from different builds"
#endif
#if ARS_CONTROLLER_BUILD != ARS_ECU_CONFIG_BUILD
#error "ars_controller.h and ars_ecu_config.h come from different builds"
#endif
#if ARS_MAP_BUILD != ARS_ECU_CONFIG_BUILD
#error "ars_map.h and ars_ecu_config.h come from different builds"
#endif
#if ARS_TASK_BUILD != ARS_ECU_CONFIG_BUILD
#error "ars_task.h and ars_ecu_config.h come from different builds"
#endif

/* The task. */
#define ARS_ECU_RUN_TASK ars_task_10ms
#define ARS_ECU_PERIOD_NS INT64_C(10000000)
#define ARS_ECU_PERIOD_TEXT "10 ms"

/* Ends of the section that ARS_SECTION_CALIBRATION names; defined by the linker (GNU ld, lld). */
#define ARS_ECU_CALIBRATION_START __start_ars_calibration
#define ARS_ECU_CALIBRATION_STOP __stop_ars_calibration

/* Size of all objects in that section, in bytes. */
#define ARS_ECU_CALIBRATION_SIZE \
    (sizeof ars_parameters_default + sizeof ars_calibration_expected_checksum \
        + sizeof ars_map_speed_breakpoints \
        + sizeof ars_map_front_angle_breakpoints \
        + sizeof ars_map_yaw_rate_table)

/* Identifiers of the CAN frames that carry XCP packets. */
#define ARS_XCP_ID_RECEIVE 0x6A0  /* commands of the master */
#define ARS_XCP_ID_TRANSMIT 0x6A1 /* answers and measurements */
#define ARS_XCP_IDS_TEXT "0x6A0 and 0x6A1"

/* Largest packets, in bytes. */
#define ARS_XCP_COMMAND_MAX 8     /* command or answer: MAX_CTO */
#define ARS_XCP_MEASUREMENT_MAX 8 /* measurement: MAX_DTO */

/* Names that a master can upload: the build, the A2L file ars.a2l without its extension, and the event. */
#define ARS_XCP_BUILD_NAME "4ws2-paper"
#define ARS_XCP_A2L_NAME "ars"
#define ARS_XCP_EVENT_NAME "task_10ms"

/* Timestamps of two bytes, in units of 1 ms. */
#define ARS_XCP_TIMESTAMP_MODE 0x62u
#define ARS_XCP_TICKS_PER_RUN 10u

/* Period of the event, in units of 1 ms. */
#define ARS_XCP_EVENT_CYCLE 10u
#define ARS_XCP_EVENT_UNIT 6u

#endif /* ARS_ECU_CONFIG_H */
