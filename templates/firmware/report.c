/*
 * Lines of text without a C library. See report.h.
 */
#include "report.h"

enum { DECIMALS_MAX = 10 }; /* digits of 32 bits */

void report_init(report_t *self)
{
    self->length = 0u;
    self->text[0] = '\0';
}

static void put(report_t *self, char character)
{
    if (self->length < (uint32_t)REPORT_LENGTH_MAX) {
        self->text[self->length] = character;
        self->length++;
        self->text[self->length] = '\0';
    }
}

void report_text(report_t *self, const char *text)
{
    uint32_t at;

    for (at = 0u; text[at] != '\0'; at++) {
        put(self, text[at]);
    }
}

void report_decimal(report_t *self, uint32_t value)
{
    char digits[DECIMALS_MAX];
    uint32_t count = 0u;
    uint32_t rest = value;

    do {
        digits[count] = (char)('0' + (char)(rest % 10u));
        rest /= 10u;
        count++;
    } while (rest > 0u);
    while (count > 0u) {
        count--;
        put(self, digits[count]);
    }
}

void report_hex(report_t *self, uint32_t value, uint32_t digits)
{
    static const char names[] = "0123456789ABCDEF";
    uint32_t left;

    for (left = digits; left > 0u; left--) {
        put(self, names[(value >> (4u * (left - 1u))) & 0xFu]);
    }
}

void report_value(report_t *self, const char *name, uint32_t value)
{
    report_text(self, " ");
    report_text(self, name);
    report_text(self, "=");
    report_decimal(self, value);
}
