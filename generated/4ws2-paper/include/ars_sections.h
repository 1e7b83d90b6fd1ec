/*
 * Linker sections of the generated code.
 *
 * Each macro stands before the definitions of its kind and is empty by default. To place them, define the macros on the
 * compiler's command line, for example
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

/* Constants that never change: the checksum table and the like. */
#ifndef ARS_SECTION_CONST
#define ARS_SECTION_CONST
#endif

/* Parameters and the reference map: read-only for the code, changed by calibration. */
#ifndef ARS_SECTION_CALIBRATION
#define ARS_SECTION_CALIBRATION
#endif

/* Controller states. All of them are the caller's; the example shows the use. */
#ifndef ARS_SECTION_STATE
#define ARS_SECTION_STATE
#endif

#endif /* ARS_SECTIONS_H */
