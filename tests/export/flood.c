/*
 * A bus that sends random operations to a node, compiled with the sources of an FMU. The arguments are its instantiation token and the
 * value references of Rx_Clock and BusNotifications; Rx_Data, Tx_Clock and Tx_Data follow Rx_Clock. With those of task_is_clocked and
 * task_clock, this clock runs the task: it ticks, or tries to, in every event. Ends with 0 if no other call fails.
 */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"

static uint32_t state = 1u;

static uint32_t next_random(void)
{
    state ^= state << 13;
    state ^= state >> 17;
    state ^= state << 5;
    return state;
}

/* Write a random operation, mostly with a known code and a plausible length. Returns its size. */
static size_t operation(uint8_t *bytes)
{
    static const uint8_t codes[] = { 0x01, 0x10, 0x11, 0x12, 0x20, 0x30, 0x31, 0x40, 0x41, 0x42, 0x99 };
    static const uint8_t lengths[] = { 10, 24, 25, 30, 12, 12, 15, 13, 9, 8, 8 };
    const uint32_t kind = next_random() % 11u;
    uint32_t size = lengths[kind];
    uint32_t k;

    for (k = 0u; k < 64u; k++) {
        bytes[k] = (uint8_t)next_random();
    }
    memset(bytes, 0, 8u);
    bytes[0] = codes[kind];
    bytes[4] = (uint8_t)size;
    if ((next_random() % 4u) != 0u) { /* identifiers and lengths of data that occur */
        static const uint8_t head[] = { 1, 2, 0, 0, 0, 0, 8, 0 };

        memcpy(&bytes[8], head, (kind == 0u) ? 0u : sizeof(head));
        bytes[8] = (uint8_t)(1u + (next_random() % 2u));
    }
    if ((next_random() % 16u) == 0u) {
        bytes[4 + (next_random() % 4u)] = (uint8_t)next_random();
        size = 8u + (next_random() % 50u);
    }
    return size;
}

int main(int count, char **arguments)
{
    const fmi3ValueReference first = (count > 3) ? (fmi3ValueReference)atoi(arguments[2]) : 0u;
    const fmi3ValueReference rx_clock = first, rx_data = first + 1u, tx_clock = first + 2u, tx_data = first + 3u;
    const fmi3ValueReference notifications = (count > 3) ? (fmi3ValueReference)atoi(arguments[3]) : 0u;
    const bool is_clocked = count > 5;
    const fmi3ValueReference task_is_clocked = is_clocked ? (fmi3ValueReference)atoi(arguments[4]) : 0u;
    const fmi3ValueReference task_clock = is_clocked ? (fmi3ValueReference)atoi(arguments[5]) : 0u;
    const fmi3Boolean yes = true;
    const fmi3Clock tick = true;
    fmi3Instance node = fmi3InstantiateCoSimulation(
        "node", arguments[1], NULL, false, false, true, false, NULL, 0u, NULL, NULL, NULL);
    uint64_t frames = 0u;
    int ticks = 0;
    int failed = (node == NULL);
    int k;

    failed |= fmi3SetBoolean(node, &notifications, 1u, &yes, 1u);
    if (is_clocked) {
        failed |= fmi3SetBoolean(node, &task_is_clocked, 1u, &yes, 1u);
    }
    failed |= fmi3EnterInitializationMode(node, false, 0.0, 0.0, false, 0.0);
    failed |= fmi3ExitInitializationMode(node);
    for (k = 0; k < 20000; k++) {
        uint8_t bytes[2048];
        size_t size = 0u;
        size_t sent;
        fmi3Binary value = bytes;
        fmi3Binary answer;
        fmi3Clock clock;
        const bool in_event = (next_random() % 2u) != 0u; /* else before the step */
        fmi3Boolean again, event, ends, early, changed, nominal, defined;
        double time;

        while ((size + 64u < sizeof(bytes)) && ((next_random() % 40u) != 0u)) {
            size += operation(&bytes[size]);
        }
        if (in_event) {
            failed |= fmi3SetClock(node, &rx_clock, 1u, &tick);
            failed |= fmi3SetBinary(node, &rx_data, 1u, &size, &value, 1u);
        }
        failed |= fmi3GetClock(node, &tx_clock, 1u, &clock);
        failed |= fmi3GetBinary(node, &tx_data, 1u, &sent, &answer, 1u);
        frames += sent;
        if (is_clocked && (fmi3SetClock(node, &task_clock, 1u, &tick) == fmi3OK)) { /* once in 20 events */
            ticks++;
        }
        failed |= fmi3UpdateDiscreteStates(node, &again, &ends, &nominal, &changed, &defined, &time);
        failed |= fmi3EnterStepMode(node);
        if (!in_event) {
            failed |= fmi3SetClock(node, &rx_clock, 1u, &tick);
            failed |= fmi3SetBinary(node, &rx_data, 1u, &size, &value, 1u);
        }
        failed |= fmi3DoStep(node, 0.0005 * k, 0.0005, true, &event, &ends, &early, &time);
        failed |= fmi3EnterEventMode(node);
    }
    fmi3FreeInstance(node);
    fprintf(stderr, "%lu bytes sent\n", (unsigned long)frames);
    return failed || (frames < 20000u) || (is_clocked && (ticks != 1000));
}
