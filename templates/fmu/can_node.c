/*
 * Node on a virtual CAN bus. See can_node.h.
 */
#include "can_node.h"

#include <string.h>

/* Operation codes. */
enum {
    OP_FORMAT_ERROR = 0x01,
    OP_CAN_TRANSMIT = 0x10,
    OP_CAN_FD_TRANSMIT = 0x11,
    OP_CAN_XL_TRANSMIT = 0x12,
    OP_CONFIRM = 0x20,
    OP_ARBITRATION_LOST = 0x30,
    OP_BUS_ERROR = 0x31,
    OP_CONFIGURATION = 0x40,
    OP_STATUS = 0x41,
    OP_WAKEUP = 0x42
};

enum { CONFIGURE_CAN_BAUDRATE = 0x01, CONFIGURE_CAN_FD_BAUDRATE = 0x02, CONFIGURE_ARBITRATION_LOST = 0x04 };
enum { BUFFER_AND_RETRANSMIT = 0x01 };
enum { ERROR_CODE_ACK = 0x05, PRIMARY_ERROR_FLAG = 0x01 };

/* Lengths in bytes, without data of variable length. */
enum {
    LENGTH_HEADER = 8,
    LENGTH_FORMAT_ERROR = 10,
    LENGTH_CAN_TRANSMIT = 16,
    LENGTH_CAN_FD_TRANSMIT = 17,
    LENGTH_CAN_XL_TRANSMIT = 22,
    LENGTH_CONFIRM = 12,
    LENGTH_BUS_ERROR = 15,
    LENGTH_CONFIGURATION = 9,
    LENGTH_STATUS = 9
};

/* Largest frames, in bytes of data. */
enum { CAN_DATA_MAX = 8, CAN_FD_DATA_MAX = 64 };

/* Limits and increments of ISO 11898-1, fault confinement. */
enum {
    PASSIVE_ABOVE = 127,
    BUS_OFF_ABOVE = 255,
    RECEIVE_ERRORS_MAX = 255,
    RECEIVE_ERRORS_AFTER_SUCCESS = 119, /* of a node that was error passive */
    ERRORS_OF_DETECTOR = 8,
    ERRORS_OF_LISTENER = 1
};

/* ---- numbers ---- */

static void put(can_buffer_t *buffer, uint32_t value, uint32_t size)
{
    uint32_t k;

    for (k = 0u; k < size; k++) {
        buffer->bytes[buffer->size] = (uint8_t)(value >> (8u * k));
        buffer->size++;
    }
}

static uint32_t number_at(const uint8_t *bytes, uint32_t size)
{
    uint32_t value = 0u;
    uint32_t k;

    for (k = 0u; k < size; k++) {
        value |= (uint32_t)bytes[k] << (8u * k);
    }
    return value;
}

/* ---- operations to the bus ---- */

/* Begin an operation of a length in bytes. Returns false, and adds nothing, if it does not fit. */
static bool begin(can_node_t *self, uint32_t code, uint32_t length)
{
    if (length > ((uint32_t)CAN_BUFFER_SIZE - self->transmit.size)) {
        return false;
    }
    put(&self->transmit, code, 4u);
    put(&self->transmit, length, 4u);
    return true;
}

static void put_bytes(can_node_t *self, const uint8_t *bytes, uint32_t size)
{
    memcpy(&self->transmit.bytes[self->transmit.size], bytes, size);
    self->transmit.size += size;
}

static void put_transmit(can_node_t *self, uint32_t id, const uint8_t *data)
{
    const bool is_fd = CAN_DATA_BIT_RATE != 0;
    const uint32_t head = is_fd ? (uint32_t)LENGTH_CAN_FD_TRANSMIT : (uint32_t)LENGTH_CAN_TRANSMIT;

    if (begin(self, is_fd ? (uint32_t)OP_CAN_FD_TRANSMIT : (uint32_t)OP_CAN_TRANSMIT, head + (uint32_t)CAN_FRAME_BYTES)) {
        put(&self->transmit, id, 4u);
        put(&self->transmit, (uint32_t)CAN_IS_EXTENDED, 1u);
        if (is_fd) {
            put(&self->transmit, 1u, 1u); /* bit-rate switching */
            put(&self->transmit, (self->status == CAN_ERROR_PASSIVE) ? 1u : 0u, 1u);
        } else {
            put(&self->transmit, 0u, 1u); /* no remote frame */
        }
        put(&self->transmit, (uint32_t)CAN_FRAME_BYTES, 2u);
        put_bytes(self, data, (uint32_t)CAN_FRAME_BYTES);
    }
}

static void put_status(can_node_t *self)
{
    if (begin(self, OP_STATUS, LENGTH_STATUS)) {
        put(&self->transmit, (uint32_t)self->status, 1u);
    }
}

/* Return the operation that cannot be understood. What does not fit the buffer is left out. */
static void put_format_error(can_node_t *self, const uint8_t *operation, uint32_t size)
{
    const uint32_t room = (uint32_t)CAN_BUFFER_SIZE - self->transmit.size;
    const uint32_t most = (room > (uint32_t)LENGTH_FORMAT_ERROR) ? (room - (uint32_t)LENGTH_FORMAT_ERROR) : 0u;
    const uint32_t count = (size < most) ? size : most;

    if (begin(self, OP_FORMAT_ERROR, (uint32_t)LENGTH_FORMAT_ERROR + count)) {
        put(&self->transmit, count, 2u);
        put_bytes(self, operation, count);
    }
}

/* ---- frames that are not confirmed yet ---- */

/* The mailbox of an identifier, else a free one; null if there is none. */
static can_mailbox_t *mailbox_of(can_node_t *self, uint32_t id)
{
    can_mailbox_t *found = NULL;
    uint32_t k;

    for (k = 0u; k < (uint32_t)CAN_MAILBOXES; k++) {
        can_mailbox_t *box = &self->mailboxes[k];

        if (box->is_pending && (box->id == id)) {
            return box;
        }
        if (!box->is_pending) {
            found = box;
        }
    }
    return found;
}

static void repeat(can_node_t *self, uint32_t id)
{
    const can_mailbox_t *box = mailbox_of(self, id);

    if ((box != NULL) && box->is_pending && (self->status != CAN_BUS_OFF)) {
        put_transmit(self, id, box->data);
    }
}

/* ---- state of the node ---- */

/* Derive the state from the counters. The bus is told of each change. */
static void update_status(can_node_t *self)
{
    const bool is_passive = (self->transmit_errors > PASSIVE_ABOVE) || (self->receive_errors > PASSIVE_ABOVE);
    int32_t status = is_passive ? CAN_ERROR_PASSIVE : CAN_ERROR_ACTIVE;

    if (self->transmit_errors > BUS_OFF_ABOVE) {
        status = CAN_BUS_OFF;
        self->restart_steps = CAN_RESTART_STEPS;
        memset(self->mailboxes, 0, sizeof(self->mailboxes));
    }
    if (status != self->status) {
        self->status = status;
        put_status(self);
    }
}

static void on_confirm(can_node_t *self, uint32_t id)
{
    can_mailbox_t *box = mailbox_of(self, id);

    if ((box != NULL) && box->is_pending) {
        memset(box, 0, sizeof(*box));
    }
    if (self->transmit_errors > 0) {
        self->transmit_errors--;
    }
    update_status(self);
}

static void on_bus_error(can_node_t *self, uint32_t id, uint8_t code, uint8_t flag, bool is_sender)
{
    if (is_sender) {
        /* A node that is alone on the bus must not go bus off because nobody acknowledges. */
        if ((self->status != CAN_ERROR_PASSIVE) || (code != (uint8_t)ERROR_CODE_ACK)) {
            self->transmit_errors += ERRORS_OF_DETECTOR;
        }
    } else {
        self->receive_errors += (flag == (uint8_t)PRIMARY_ERROR_FLAG) ? ERRORS_OF_DETECTOR : ERRORS_OF_LISTENER;
        if (self->receive_errors > RECEIVE_ERRORS_MAX) {
            self->receive_errors = RECEIVE_ERRORS_MAX;
        }
    }
    update_status(self);
    if (is_sender) {
        repeat(self, id);
    }
}

static void on_frame(can_node_t *self, const uint8_t *operation, can_receiver_t receiver, void *owner)
{
    const bool is_fd = number_at(operation, 4u) == (uint32_t)OP_CAN_FD_TRANSMIT;
    const uint32_t head = is_fd ? (uint32_t)LENGTH_CAN_FD_TRANSMIT : (uint32_t)LENGTH_CAN_TRANSMIT;
    const uint32_t id = number_at(&operation[8], 4u);
    const bool is_extended = operation[12] != 0u;
    const bool is_remote = !is_fd && (operation[13] != 0u);
    const uint32_t length = number_at(&operation[head - 2u], 2u);

    if (self->receive_errors > PASSIVE_ABOVE) {
        self->receive_errors = RECEIVE_ERRORS_AFTER_SUCCESS;
    } else if (self->receive_errors > 0) {
        self->receive_errors--;
    } else {
        /* no errors */
    }
    update_status(self);
    if ((is_fd == (CAN_DATA_BIT_RATE != 0)) && (is_extended == (CAN_IS_EXTENDED != 0)) && !is_remote) {
        receiver(owner, id, &operation[head], (uint8_t)length);
    }
}

/* ---- operations from the bus ---- */

/* Return whether an operation has the length that its code requires. */
static bool is_well_formed(const uint8_t *operation, uint32_t length)
{
    bool good = false;

    switch (number_at(operation, 4u)) {
    case OP_FORMAT_ERROR:
        good = (length >= (uint32_t)LENGTH_FORMAT_ERROR) && (length == ((uint32_t)LENGTH_FORMAT_ERROR + number_at(&operation[8], 2u)));
        break;
    case OP_CAN_TRANSMIT:
        good = (length >= (uint32_t)LENGTH_CAN_TRANSMIT) && (length == ((uint32_t)LENGTH_CAN_TRANSMIT + number_at(&operation[14], 2u)))
            && (length <= ((uint32_t)LENGTH_CAN_TRANSMIT + (uint32_t)CAN_DATA_MAX));
        break;
    case OP_CAN_FD_TRANSMIT:
        good = (length >= (uint32_t)LENGTH_CAN_FD_TRANSMIT)
            && (length == ((uint32_t)LENGTH_CAN_FD_TRANSMIT + number_at(&operation[15], 2u)))
            && (length <= ((uint32_t)LENGTH_CAN_FD_TRANSMIT + (uint32_t)CAN_FD_DATA_MAX));
        break;
    case OP_CAN_XL_TRANSMIT:
        good = (length >= (uint32_t)LENGTH_CAN_XL_TRANSMIT)
            && (length == ((uint32_t)LENGTH_CAN_XL_TRANSMIT + number_at(&operation[20], 2u)));
        break;
    case OP_CONFIRM:
    case OP_ARBITRATION_LOST:
        good = length == (uint32_t)LENGTH_CONFIRM;
        break;
    case OP_BUS_ERROR:
        good = length == (uint32_t)LENGTH_BUS_ERROR;
        break;
    case OP_CONFIGURATION:
        good = length > (uint32_t)LENGTH_CONFIGURATION;
        break;
    case OP_STATUS:
        good = length == (uint32_t)LENGTH_STATUS;
        break;
    case OP_WAKEUP:
        good = length == (uint32_t)LENGTH_HEADER;
        break;
    default:
        break;
    }
    return good;
}

/* Process a well-formed operation. Operations for the bus, of other kinds of CAN, and of format errors need no reaction; a wakeup
 * neither, since the node does not sleep. */
static void process(can_node_t *self, const uint8_t *operation, can_receiver_t receiver, void *owner)
{
    const uint32_t code = number_at(operation, 4u);

    if ((code == (uint32_t)OP_CAN_TRANSMIT) || ((CAN_DATA_BIT_RATE != 0) && (code == (uint32_t)OP_CAN_FD_TRANSMIT))) {
        on_frame(self, operation, receiver, owner);
    } else if (self->notifications && (code == (uint32_t)OP_CONFIRM)) {
        on_confirm(self, number_at(&operation[8], 4u));
    } else if (self->notifications && (code == (uint32_t)OP_ARBITRATION_LOST)) {
        repeat(self, number_at(&operation[8], 4u));
    } else if (self->notifications && (code == (uint32_t)OP_BUS_ERROR)) {
        on_bus_error(self, number_at(&operation[8], 4u), operation[12], operation[13], operation[14] != 0u);
    } else {
        /* ignored */
    }
}

bool can_node_receive(can_node_t *self, const uint8_t *bytes, size_t size)
{
    const size_t last = (size_t)self->receive.size - (size_t)self->received_from;

    if ((size == 0u) || ((size == last) && (memcmp(&self->receive.bytes[self->received_from], bytes, size) == 0))) {
        return true;
    }
    if (size > ((size_t)CAN_BUFFER_SIZE - (size_t)self->receive.size)) {
        return false;
    }
    memcpy(&self->receive.bytes[self->receive.size], bytes, size);
    self->received_from = self->receive.size;
    self->receive.size += (uint32_t)size;
    return true;
}

void can_node_process(can_node_t *self, can_receiver_t receiver, void *owner)
{
    uint32_t start = 0u;

    while (start < self->receive.size) {
        const uint8_t *operation = &self->receive.bytes[start];
        const uint32_t rest = self->receive.size - start;
        const uint32_t length = (rest < (uint32_t)LENGTH_HEADER) ? 0u : number_at(&operation[4], 4u);

        if ((length < (uint32_t)LENGTH_HEADER) || (length > rest)) { /* the next operation cannot be found */
            put_format_error(self, operation, rest);
            break;
        }
        if (!is_well_formed(operation, length)) {
            put_format_error(self, operation, length);
        } else if (self->status != CAN_BUS_OFF) {
            process(self, operation, receiver, owner);
        } else {
            /* off */
        }
        start += length;
    }
}

/* ---- the node ---- */

void can_node_init(can_node_t *self)
{
    self->status = CAN_ERROR_ACTIVE;
    if (begin(self, OP_CONFIGURATION, (uint32_t)LENGTH_CONFIGURATION + 4u)) {
        put(&self->transmit, CONFIGURE_CAN_BAUDRATE, 1u);
        put(&self->transmit, CAN_BIT_RATE, 4u);
    }
    if ((CAN_DATA_BIT_RATE != 0) && begin(self, OP_CONFIGURATION, (uint32_t)LENGTH_CONFIGURATION + 4u)) {
        put(&self->transmit, CONFIGURE_CAN_FD_BAUDRATE, 1u);
        put(&self->transmit, CAN_DATA_BIT_RATE, 4u);
    }
    if (begin(self, OP_CONFIGURATION, (uint32_t)LENGTH_CONFIGURATION + 1u)) {
        put(&self->transmit, CONFIGURE_ARBITRATION_LOST, 1u);
        put(&self->transmit, BUFFER_AND_RETRANSMIT, 1u);
    }
}

void can_node_send(can_node_t *self, uint32_t id, const uint8_t data[CAN_FRAME_BYTES])
{
    can_mailbox_t *box = self->notifications ? mailbox_of(self, id) : NULL;

    if (self->status == CAN_BUS_OFF) {
        return;
    }
    if (box != NULL) {
        box->id = id;
        box->is_pending = true;
        memcpy(box->data, data, CAN_FRAME_BYTES);
    }
    put_transmit(self, id, data);
}

void can_node_step(can_node_t *self)
{
    if (self->status == CAN_BUS_OFF) {
        self->restart_steps--;
        if (self->restart_steps == 0u) {
            self->transmit_errors = 0;
            self->receive_errors = 0;
            update_status(self);
        }
    }
}
