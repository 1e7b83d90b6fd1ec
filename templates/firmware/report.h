/*
 * Lines of text without a C library.
 */
#ifndef REPORT_H
#define REPORT_H

#include <stdint.h>

enum { REPORT_LENGTH_MAX = 159 /* a frame of CAN FD, or the last line */ };

/* One line of text. Characters that do not fit are dropped. */
typedef struct {
    char text[REPORT_LENGTH_MAX + 1];
    uint32_t length;
} report_t;

/* Start an empty line, then append text or a decimal number. */
void report_init(report_t *self);
void report_text(report_t *self, const char *text);
void report_decimal(report_t *self, uint32_t value);

/* Append the lowest hexadecimal digits, 1 to 8. */
void report_hex(report_t *self, uint32_t value, uint32_t digits);

/* Append " name=" and the value in decimals. */
void report_value(report_t *self, const char *name, uint32_t value);

#endif /* REPORT_H */
