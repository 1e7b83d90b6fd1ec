/*
 * Proof of lemma_sound(), which other proofs assume. See ars_contracts.h.
 *
 * Run in the folder of the build, with CBMC 6 and Bitwuzla:
 *
 * cbmc verify/prove_lemma_sound.c -Iinclude -Iverify --function prove_lemma_sound --unwind 16 --bounds-check --pointer-check --div-by-zero-check --float-div-by-zero-check --signed-overflow-check --conversion-check --undefined-shift-check --no-standard-checks --unwinding-assertions --slice-formula --bitwuzla
 *
 * The proof counts if CBMC reports VERIFICATION SUCCESSFUL, and if check_end.assertion.1 fails with -DCHECK_END.
 *
 * Map 4ws2-paper: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#define CONTRACT_REQUIRE(condition, text) __CPROVER_assume(condition)
#define CONTRACT_ENSURE(condition, text) __CPROVER_assert(condition, text)
#define CONTRACT_LEMMA_SOUND(condition, text) __CPROVER_assert(condition, text)

#include "../src/ars_controller.c"
#include "ars_contracts.h"

#ifndef CONTRACT_LEMMA_SOUND
#define CONTRACT_LEMMA_SOUND(condition, text) __CPROVER_assume(condition)
#endif
/* Both ways. A sum of squares of at most 1.0e+12f has no square above it, but for rounding. */
static inline void lemma_sound(const ars_controller_t *self)
{
    const bool sound = is_sound(self);

    CONTRACT_LEMMA_SOUND(sound || !ars_controller_holds(self), "a state within its invariant is sound");
    CONTRACT_LEMMA_SOUND(!sound || (self->initialised == (uint32_t)ARS_CONTROLLER_INITIALISED), "a sound state is initialised");
    CONTRACT_LEMMA_SOUND(!sound || lies_within(self->limiter.rear_angle, 1.001e+06f), "a sound state has a finite limiter.rear_angle");
    CONTRACT_LEMMA_SOUND(!sound || lies_within(self->inputs.speed.value, 1.001e+06f), "a sound state has a finite inputs.speed.value");
    CONTRACT_LEMMA_SOUND(!sound || lies_within(self->inputs.front_angle.value, 1.001e+06f), "a sound state has a finite inputs.front_angle.value");
    CONTRACT_LEMMA_SOUND(!sound || lies_within(self->inputs.yaw_rate.value, 1.001e+06f), "a sound state has a finite inputs.yaw_rate.value");
    CONTRACT_LEMMA_SOUND(!sound || lies_within(self->inputs.expected_yaw_rate, 1.001e+06f), "a sound state has a finite inputs.expected_yaw_rate");
    CONTRACT_LEMMA_SOUND(!sound || lies_within(self->inputs.beyond_linear, 1.001e+06f), "a sound state has a finite inputs.beyond_linear");
    CONTRACT_LEMMA_SOUND(!sound || lies_within(self->inputs.least, 1.001e+06f), "a sound state has a finite inputs.least");
    CONTRACT_LEMMA_SOUND(!sound || lies_within(self->inputs.least_of_front, 1.001e+06f), "a sound state has a finite inputs.least_of_front");
    CONTRACT_LEMMA_SOUND(!sound || lies_within(self->inputs.yaw_rate_offset, 1.001e+06f), "a sound state has a finite inputs.yaw_rate_offset");
    CONTRACT_LEMMA_SOUND(!sound || lies_within(self->inputs.lateral_acceleration_offset, 1.001e+06f), "a sound state has a finite inputs.lateral_acceleration_offset");
    CONTRACT_LEMMA_SOUND(!sound || lies_within(self->inputs.friction, 1.001e+06f), "a sound state has a finite inputs.friction");
    CONTRACT_LEMMA_SOUND(!sound || lies_within(self->inputs.lateral_acceleration, 1.001e+06f), "a sound state has a finite inputs.lateral_acceleration");
    CONTRACT_LEMMA_SOUND(!sound || lies_within(self->inputs.least_of_lateral, 1.001e+06f), "a sound state has a finite inputs.least_of_lateral");
    CONTRACT_LEMMA_SOUND(!sound || lies_within(self->law.integral, 1.001e+06f), "a sound state has a finite law.integral");
    CONTRACT_LEMMA_SOUND(!sound || lies_within(self->rear_angle, 1.001e+06f), "a sound state has a finite rear_angle");
    CONTRACT_LEMMA_SOUND(!sound || lies_within(self->yaw_rate_error, 1.001e+06f), "a sound state has a finite yaw_rate_error");
}

/* The end of a proof. With CHECK_END its assertion must fail: otherwise no claim was reached. */
static void check_end(void)
{
#ifdef CHECK_END
    __CPROVER_assert(false, "the end is reached");
#endif
}

void prove_lemma_sound(void);

/* Locals without a value have any value. */
void prove_lemma_sound(void)
{
    ars_controller_t self;

    lemma_sound(&self);
    check_end();
}
