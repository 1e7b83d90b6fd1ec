/*
 * Protection of CAN frames: AUTOSAR E2E profile 1, variant 1A.
 *
 * A frame has eight bytes: the CRC in byte 0, the counter (0 to 14) in the low nibble of byte 1, and signals in the rest. The CRC
 * covers the data id, low byte first, and bytes 1 to 7. Specification: AUTOSAR FO R20-11, PRS_E2EProtocol, section 6.3
 * (E2E_P01Protect and E2E_P01Check), with MaxDeltaCounterInit 1, MaxNoNewOrRepeatedData 3, SyncCounterInit 1.
 *
 * The state of a message follows the E2E state machine (E2E_SMCheck) of the same specification over a window of 6 cycles:
 *
 *     from INIT to VALID       at least  2 good and at most 2 damaged
 *     VALID stays              at least  2 good and at most 3 damaged, else INVALID
 *     from INVALID to VALID    at least  3 good and at most 2 damaged
 *
 * A message that loses more than 4 of any 6 cycles, in any pattern, is therefore INVALID within 60 ms.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#ifndef ARS_E2E_H
#define ARS_E2E_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define ARS_E2E_BUILD 0xC9A75925u

/* Result of a check. The data are used only with OK, INITIAL and OK_SOME_LOST. */
typedef enum {
    ARS_E2E_OK = 0,
    ARS_E2E_NO_NEW_DATA = 1,     /* no frame in this cycle */
    ARS_E2E_WRONG_CRC = 2,       /* damaged, for another receiver, or counter 15 */
    ARS_E2E_SYNC = 3,            /* correct, but the counter is still being synchronised */
    ARS_E2E_INITIAL = 4,         /* the first correct frame; any counter is accepted */
    ARS_E2E_REPEATED = 5,        /* counter not advanced */
    ARS_E2E_OK_SOME_LOST = 6,    /* correct, after a few lost frames */
    ARS_E2E_WRONG_SEQUENCE = 7   /* the counter advanced too far, or backwards */
} ars_e2e_status_t;

/* State of one receiver. Private. */
typedef struct {
    uint8_t last_counter;                       /* counter of the last correct frame */
    uint8_t max_delta_counter;                  /* largest accepted advance of the next counter */
    uint8_t sync_counter;                       /* correct frames still required for synchronisation */
    uint8_t no_new_or_repeated_data_counter;    /* cycles without new data */
    bool waits_for_first;                       /* no correct frame so far */
} ars_e2e_receiver_t;

/* State of a message. Its data are used only in the state VALID. Memory that is all zero is NO_DATA, which is safe. */
typedef enum {
    ARS_E2E_STATE_NO_DATA = 0,   /* no correct frame so far */
    ARS_E2E_STATE_INIT = 1,      /* too few good frames so far */
    ARS_E2E_STATE_VALID = 2,
    ARS_E2E_STATE_INVALID = 3    /* too many frames lost or damaged */
} ars_e2e_state_t;

/* History of a message over the last cycles. Private. */
typedef struct {
    uint32_t window;                            /* lower half: good cycles, upper half: damaged ones; bit 0 of each: last cycle */
    ars_e2e_state_t state;
} ars_e2e_supervision_t;

/* Return the CRC-8 (polynomial 0x1D, start value 0) over the data id and bytes 1 to 7. */
uint8_t ars_e2e_crc(uint16_t data_id, const uint8_t data[8]);

/* Write CRC (byte 0) and counter (low nibble of byte 1) into a frame, then advance *counter, which wraps from 14 to 0. */
void ars_e2e_protect(uint16_t data_id, uint8_t *counter, uint8_t data[8]);

/* Initialise a receiver. Call it before the first frame. */
void ars_e2e_receiver_init(ars_e2e_receiver_t *self);

/* Check a received frame of eight bytes. Call it once for each frame. */
ars_e2e_status_t ars_e2e_check(ars_e2e_receiver_t *self, uint16_t data_id, const uint8_t data[8]);

/* Record a cycle without a frame. Returns NO_NEW_DATA. */
ars_e2e_status_t ars_e2e_no_new_data(ars_e2e_receiver_t *self);

/* Initialise the supervision of a message. Call it before the first cycle. */
void ars_e2e_supervision_init(ars_e2e_supervision_t *self);

/*
 * End a cycle of one message and return its state. Call it once a cycle.
 *
 * is_good:    a frame was received whose data may be used.
 * is_damaged: a frame with a wrong CRC or length was received.
 * Both are false if there was no frame, or only repeated frames and frames out of sequence. Both can be true if several frames
 * were received.
 */
ars_e2e_state_t ars_e2e_supervise(ars_e2e_supervision_t *self, bool is_good, bool is_damaged);

#ifdef __cplusplus
}
#endif

#endif /* ARS_E2E_H */
