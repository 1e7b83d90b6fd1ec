/*
 * Protection of CAN frames: AUTOSAR E2E profile 1, variant 1A.
 *
 * A frame has eight bytes: the CRC in byte 0, the counter (0 to 14) in the low nibble of byte 1, signals in the rest. The CRC
 * covers the data id, low byte first, and bytes 1 to 7. Behaviour: AUTOSAR FO R20-11, PRS_E2EProtocol, section 6.3
 * (E2E_P01Protect and E2E_P01Check), with MaxDeltaCounterInit 1, MaxNoNewOrRepeatedData 3, SyncCounterInit 1.
 *
 * The state of a message is that of the E2E state machine (E2E_SMCheck) of the same specification, over a window of 6 cycles:
 *
 *     from INIT to VALID       at least  2 good and at most 1 damaged
 *     VALID stays              at least  2 good and at most 3 damaged, else INVALID
 *     from INVALID to VALID    at least  3 good and at most 2 damaged
 *
 * A message of which more than 4 of any 6 cycles are lost is therefore INVALID within 60 ms, in whatever pattern they are lost.
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

#define ARS_E2E_BUILD 0x3CA513E9u

/* What a check found. Only with OK, INITIAL and OK_SOME_LOST are the data used here. */
typedef enum {
    ARS_E2E_OK = 0,
    ARS_E2E_NO_NEW_DATA = 1,     /* no frame in this cycle */
    ARS_E2E_WRONG_CRC = 2,       /* damaged, meant for another receiver, or with a counter of 15 */
    ARS_E2E_SYNC = 3,            /* right, but the counter must prove itself again first */
    ARS_E2E_INITIAL = 4,         /* the first frame: right, its counter is taken as it is */
    ARS_E2E_REPEATED = 5,        /* the counter did not advance */
    ARS_E2E_OK_SOME_LOST = 6,    /* right, and a few were lost before it */
    ARS_E2E_WRONG_SEQUENCE = 7   /* the counter jumped too far, or backwards */
} ars_e2e_status_t;

/* Memory of one receiver. Private. */
typedef struct {
    uint8_t last_counter;                       /* of the last frame that was right */
    uint8_t max_delta_counter;                  /* how far the next counter may advance */
    uint8_t sync_counter;                       /* frames in sequence that are still asked for */
    uint8_t no_new_or_repeated_data_counter;    /* cycles without news */
    bool waits_for_first;                       /* no right frame so far */
} ars_e2e_receiver_t;

/* State of a message. Its data are used only where it is VALID. Zero, which is what memory holds before the first call, is safe. */
typedef enum {
    ARS_E2E_STATE_NO_DATA = 0,   /* no right frame so far */
    ARS_E2E_STATE_INIT = 1,      /* too few good ones so far */
    ARS_E2E_STATE_VALID = 2,
    ARS_E2E_STATE_INVALID = 3    /* too many lost or damaged */
} ars_e2e_state_t;

/* What came of a message in the last cycles. Private. */
typedef struct {
    uint32_t window;                            /* bit 0 of either half: the last cycle; lower half: good, upper: damaged */
    ars_e2e_state_t state;
} ars_e2e_supervision_t;

/* CRC-8 (polynomial 0x1D, start value 0) over the data id and bytes 1 to 7. */
uint8_t ars_e2e_crc(uint16_t data_id, const uint8_t data[8]);

/* Write counter and CRC into a frame, then advance the counter (0 to 14). */
void ars_e2e_protect(uint16_t data_id, uint8_t *counter, uint8_t data[8]);

/* Before the first frame. */
void ars_e2e_receiver_init(ars_e2e_receiver_t *self);

/* A frame came. */
ars_e2e_status_t ars_e2e_check(ars_e2e_receiver_t *self, uint16_t data_id, const uint8_t data[8]);

/* A cycle passed without a frame. */
ars_e2e_status_t ars_e2e_no_new_data(ars_e2e_receiver_t *self);

/* Before the first cycle. */
void ars_e2e_supervision_init(ars_e2e_supervision_t *self);

/*
 * The end of a cycle of one message. Returns its state.
 *
 * is_good: a frame came whose data may be used. is_damaged: a frame came with a wrong CRC or length. Neither: no frame, or none but
 * repeated ones and ones out of sequence. Both, where several frames came, count as both.
 */
ars_e2e_state_t ars_e2e_supervise(ars_e2e_supervision_t *self, bool is_good, bool is_damaged);

#ifdef __cplusplus
}
#endif

#endif /* ARS_E2E_H */
