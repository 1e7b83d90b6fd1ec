/*
 * Node on a virtual CAN bus by FMI-LS-BUS 1.0 (FMI Layered Standard for Network Communication), chapter "CAN, CAN FD, CAN XL".
 *
 * The node exchanges bus operations with a bus simulation, with the importer, or directly with another node. Numbers are little-endian.
 * With notifications it keeps each frame until the bus confirms it, repeats it after a bus error or a lost arbitration, and counts
 * errors as ISO 11898-1 specifies: error passive, bus off, and restart. Without notifications each frame counts as sent.
 */
#ifndef CAN_NODE_H
#define CAN_NODE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "fmu_config.h"

enum { CAN_BUFFER_SIZE = 2048 };

/* Values of the operation Status. */
enum { CAN_ERROR_ACTIVE = 1, CAN_ERROR_PASSIVE = 2, CAN_BUS_OFF = 3 };

/* A frame that the bus has not confirmed. */
typedef struct {
    uint32_t id;
    bool is_pending;
    uint8_t data[CAN_FRAME_BYTES];
} can_mailbox_t;

/* Operations in the order of their processing. */
typedef struct {
    uint32_t size; /* bytes in use */
    uint8_t bytes[CAN_BUFFER_SIZE];
} can_buffer_t;

typedef struct {
    bool notifications; /* the bus confirms frames and reports errors; set before the simulation */
    int32_t status;
    int32_t transmit_errors;
    int32_t receive_errors;
    uint32_t restart_steps; /* until the node leaves bus off */
    bool frames_are_due; /* the model has frames for the next event */
    bool receive_clock;
    uint32_t received_from; /* start of the operations that were added last */
    bool is_announced; /* the simulator has read the transmit clock in this event */
    uint32_t read_size; /* bytes of the operations to the bus that the simulator has read in this event */
    bool periodic_clock; /* the periodic clock of the model ticks in this event */
    can_mailbox_t mailboxes[CAN_MAILBOXES];
    can_buffer_t transmit;
    can_buffer_t receive;
} can_node_t;

/* Called with each received data frame of the configured kind: classical or CAN FD, with 11-bit or 29-bit identifiers. */
typedef void (*can_receiver_t)(void *owner, uint32_t id, const uint8_t *data, uint8_t length);

/* Initialise a node in zeroed memory. Its first operations configure the bus: bit rates, and that the bus repeats after lost
 * arbitrations. */
void can_node_init(can_node_t *self);

/* Send a frame. A node in bus off sends nothing; a frame that does not fit the buffer is lost. */
void can_node_send(can_node_t *self, uint32_t id, const uint8_t data[CAN_FRAME_BYTES]);

/* Add received operations. Returns false, and adds nothing, if they do not fit. Equal ones twice in succession count once: a simulator
 * may set a variable again in the same event. Others are added, because some simulators set the frames of an event one by one. */
bool can_node_receive(can_node_t *self, const uint8_t *bytes, size_t size);

/* Process the received operations. */
void can_node_process(can_node_t *self, can_receiver_t receiver, void *owner);

/* Advance by one step of the model. */
void can_node_step(can_node_t *self);

#endif /* CAN_NODE_H */
