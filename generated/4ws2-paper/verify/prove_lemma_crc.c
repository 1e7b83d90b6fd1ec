/*
 * Proof of lemma_crc(), which other proofs assume. See ars_contracts.h.
 *
 * Run in the folder of the build, with CBMC 6 and Bitwuzla:
 *
 * cbmc verify/prove_lemma_crc.c -Iinclude -Iverify --function prove_lemma_crc --unwind 16 --bounds-check --pointer-check --div-by-zero-check --float-div-by-zero-check --signed-overflow-check --conversion-check --undefined-shift-check --no-standard-checks --unwinding-assertions --slice-formula --bitwuzla
 *
 * The proof counts if CBMC reports VERIFICATION SUCCESSFUL, and if check_end.assertion.1 fails with -DCHECK_END.
 *
 * Map 4ws2-paper: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#define CONTRACT_REQUIRE(condition, text) __CPROVER_assume(condition)
#define CONTRACT_ENSURE(condition, text) __CPROVER_assert(condition, text)
#define CONTRACT_LEMMA_CRC(condition, text) __CPROVER_assert(condition, text)

#include "../src/ars_e2e.c"
#include "ars_contracts.h"

#ifndef CONTRACT_LEMMA_CRC
#define CONTRACT_LEMMA_CRC(condition, text) __CPROVER_assume(condition)
#endif
/* The table of the CRC, entry by entry: the remainder of the division of a byte by the polynomial of CRC-8 SAE J1850, bit by bit. */
static inline void lemma_crc(uint32_t byte)
{
    uint32_t remainder = byte & 0xFFu;
    uint32_t k;

    for (k = 0u; k < 8u; k++) {
        remainder = ((remainder << 1u) ^ (((remainder & 0x80u) != 0u) ? 0x1Du : 0u)) & 0xFFu;
    }
    CONTRACT_LEMMA_CRC(crc_table[byte & 0xFFu] == remainder, "each entry of the table is the CRC of its byte");
}

/* The end of a proof. With CHECK_END its assertion must fail: otherwise no claim was reached. */
static void check_end(void)
{
#ifdef CHECK_END
    __CPROVER_assert(false, "the end is reached");
#endif
}

void prove_lemma_crc(void);

/* Locals without a value have any value. */
void prove_lemma_crc(void)
{
    uint32_t byte;

    lemma_crc(byte);
    check_end();
}
