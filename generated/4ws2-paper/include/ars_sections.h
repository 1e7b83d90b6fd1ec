/*
 * Linker sections of the generated code.
 *
 * Each macro precedes the definitions of its kind and is empty by default. To place these definitions, define the macros on the command
 * line of the compiler, for example
 *   -D'ARS_SECTION_CALIBRATION=__attribute__((section(".calibration")))'
 *
 * Map 4ws2-paper: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#ifndef ARS_SECTIONS_H
#define ARS_SECTIONS_H

/* Functions. */
#ifndef ARS_SECTION_CODE
#define ARS_SECTION_CODE
#endif

/* Constants that calibration does not change, such as the checksum table. */
#ifndef ARS_SECTION_CONST
#define ARS_SECTION_CONST
#endif

/* Parameters and the reference map: read-only for the code, changed by calibration. */
#ifndef ARS_SECTION_CALIBRATION
#define ARS_SECTION_CALIBRATION
#endif

/* Controller states. The caller defines them; see the example. */
#ifndef ARS_SECTION_STATE
#define ARS_SECTION_STATE
#endif

#endif /* ARS_SECTIONS_H */
