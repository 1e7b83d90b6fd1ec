/*
 * Single-track vehicle dynamics. See ars_dynamics.h.
 *
 * The straight-line functions are CasADi expression graphs with one operation a line; the typed functions below them call these.
 * Arrays hold x = [sideslip angle, yaw rate] and u = [speed, front angle, rear angle, friction].
 *
 * Map 4ws2-paper: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#include "ars_dynamics.h"

#include <math.h>

#include "ars_sections.h"

#if ARS_DYNAMICS_BUILD != 0x76CDF87Cu
#error "ars_dynamics.h and this source come from different builds"
#endif

/* A speed that is NaN counts as the lowest; a compiler that may assume there is none, or reorder sums, would change the results. */
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0))
#error "do not compile this file with -ffast-math or -ffinite-math-only"
#endif

ARS_SECTION_CODE static void linear_derivative(const float x[2], const float u[4], float dx[2])
{
    const float t0 = 1.574f * x[1];
    const float t1 = t0 / u[0];
    const float t2 = x[0] + t1;
    const float t3 = t2 - u[1];
    const float t4 = (-239080.0f) * t3;
    const float t5 = 1.566f * x[1];
    const float t6 = t5 / u[0];
    const float t7 = x[0] - t6;
    const float t8 = t7 - u[2];
    const float t9 = (-239660.0f) * t8;
    const float t10 = t4 + t9;
    const float t11 = 2335.07f * u[0];
    const float t12 = t10 / t11;
    const float t13 = t12 - x[1];
    const float t14 = (-376311.9f) * t3;
    const float t15 = (-375307.56f) * t8;
    const float t16 = t14 - t15;
    const float t17 = t16 / 5376.432f;
    dx[0] = t13;
    dx[1] = t17;
}

ARS_SECTION_CODE static void linear_jacobian(const float x[2], const float u[4], float dfdx[4], float dfdu[8])
{
    const float t0 = 2335.07f * u[0];
    const float t1 = (-478740.0f) / t0;
    const float t2 = 1.574f / u[0];
    const float t3 = (-239080.0f) * t2;
    const float t4 = 1.566f / u[0];
    const float t5 = (-239660.0f) * t4;
    const float t6 = t3 - t5;
    const float t7 = t6 / t0;
    const float t8 = t7 + (-1.0f);
    const float t9 = (-376311.9f) * t2;
    const float t10 = (-375307.56f) * t4;
    const float t11 = t9 + t10;
    const float t12 = 0.00018599696f * t11;
    const float t13 = 1.566f * x[1];
    const float t14 = t13 / u[0];
    const float t15 = t14 / u[0];
    const float t16 = (-239660.0f) * t15;
    const float t17 = 1.574f * x[1];
    const float t18 = t17 / u[0];
    const float t19 = t18 / u[0];
    const float t20 = (-239080.0f) * t19;
    const float t21 = t16 - t20;
    const float t22 = t21 / t0;
    const float t23 = x[0] + t18;
    const float t24 = t23 - u[1];
    const float t25 = (-239080.0f) * t24;
    const float t26 = x[0] - t14;
    const float t27 = t26 - u[2];
    const float t28 = (-239660.0f) * t27;
    const float t29 = t25 + t28;
    const float t30 = t29 / t0;
    const float t31 = t30 / t0;
    const float t32 = 2335.07f * t31;
    const float t33 = t22 - t32;
    const float t34 = (-376311.9f) * t19;
    const float t35 = (-375307.56f) * t15;
    const float t36 = t34 + t35;
    const float t37 = 0.00018599696f * t36;
    const float t38 = -t37;
    const float t39 = 239080.0f / t0;
    const float t40 = 239660.0f / t0;
    dfdx[0] = t1;
    dfdx[1] = (-0.1868079f);
    dfdx[2] = t8;
    dfdx[3] = t12;
    dfdu[0] = t33;
    dfdu[1] = t38;
    dfdu[2] = t39;
    dfdu[3] = 69.992874f;
    dfdu[4] = t40;
    dfdu[5] = (-69.80607f);
    dfdu[6] = 0.0f;
    dfdu[7] = 0.0f;
}

ARS_SECTION_CODE static void magic_formula_derivative(const float x[2], const float u[4], float dx[2])
{
    const float t0 = 5712.169f * u[3];
    const float t1 = 1.574f * x[1];
    const float t2 = t1 / u[0];
    const float t3 = x[0] + t2;
    const float t4 = t3 - u[1];
    const float t5 = 17.886541f * t4;
    const float t6 = atanf(t5);
    const float t7 = t5 - t6;
    const float t8 = (-0.5f) * t7;
    const float t9 = t5 - t8;
    const float t10 = atanf(t9);
    const float t11 = 1.3f * t10;
    const float t12 = sinf(t11);
    const float t13 = t0 * t12;
    const float t14 = (-2.0f) * t13;
    const float t15 = 5741.3496f * u[3];
    const float t16 = 1.566f * x[1];
    const float t17 = t16 / u[0];
    const float t18 = x[0] - t17;
    const float t19 = t18 - u[2];
    const float t20 = 17.838802f * t19;
    const float t21 = atanf(t20);
    const float t22 = t20 - t21;
    const float t23 = (-0.5f) * t22;
    const float t24 = t20 - t23;
    const float t25 = atanf(t24);
    const float t26 = 1.3f * t25;
    const float t27 = sinf(t26);
    const float t28 = t15 * t27;
    const float t29 = (-2.0f) * t28;
    const float t30 = t14 + t29;
    const float t31 = 2335.07f * u[0];
    const float t32 = t30 / t31;
    const float t33 = t32 - x[1];
    const float t34 = (-3.148f) * t13;
    const float t35 = (-3.132f) * t28;
    const float t36 = t34 - t35;
    const float t37 = t36 / 5376.432f;
    dx[0] = t33;
    dx[1] = t37;
}

ARS_SECTION_CODE static void magic_formula_jacobian(const float x[2], const float u[4], float dfdx[4], float dfdu[8])
{
    const float t0 = 5712.169f * u[3];
    const float t1 = 1.574f * x[1];
    const float t2 = t1 / u[0];
    const float t3 = x[0] + t2;
    const float t4 = t3 - u[1];
    const float t5 = 17.886541f * t4;
    const float t6 = atanf(t5);
    const float t7 = t5 - t6;
    const float t8 = (-0.5f) * t7;
    const float t9 = t5 - t8;
    const float t10 = atanf(t9);
    const float t11 = 1.3f * t10;
    const float t12 = cosf(t11);
    const float t13 = t5 * t5;
    const float t14 = 1.0f + t13;
    const float t15 = 17.886541f / t14;
    const float t16 = 17.886541f - t15;
    const float t17 = (-0.5f) * t16;
    const float t18 = 17.886541f - t17;
    const float t19 = t9 * t9;
    const float t20 = 1.0f + t19;
    const float t21 = t18 / t20;
    const float t22 = 1.3f * t21;
    const float t23 = t12 * t22;
    const float t24 = t0 * t23;
    const float t25 = (-2.0f) * t24;
    const float t26 = 5741.3496f * u[3];
    const float t27 = 1.566f * x[1];
    const float t28 = t27 / u[0];
    const float t29 = x[0] - t28;
    const float t30 = t29 - u[2];
    const float t31 = 17.838802f * t30;
    const float t32 = atanf(t31);
    const float t33 = t31 - t32;
    const float t34 = (-0.5f) * t33;
    const float t35 = t31 - t34;
    const float t36 = atanf(t35);
    const float t37 = 1.3f * t36;
    const float t38 = cosf(t37);
    const float t39 = t31 * t31;
    const float t40 = 1.0f + t39;
    const float t41 = 17.838802f / t40;
    const float t42 = 17.838802f - t41;
    const float t43 = (-0.5f) * t42;
    const float t44 = 17.838802f - t43;
    const float t45 = t35 * t35;
    const float t46 = 1.0f + t45;
    const float t47 = t44 / t46;
    const float t48 = 1.3f * t47;
    const float t49 = t38 * t48;
    const float t50 = t26 * t49;
    const float t51 = (-2.0f) * t50;
    const float t52 = t25 + t51;
    const float t53 = 2335.07f * u[0];
    const float t54 = t52 / t53;
    const float t55 = (-3.148f) * t24;
    const float t56 = (-3.132f) * t50;
    const float t57 = t55 - t56;
    const float t58 = 0.00018599696f * t57;
    const float t59 = 1.574f / u[0];
    const float t60 = 17.886541f * t59;
    const float t61 = t60 / t14;
    const float t62 = t60 - t61;
    const float t63 = (-0.5f) * t62;
    const float t64 = t60 - t63;
    const float t65 = t64 / t20;
    const float t66 = 1.3f * t65;
    const float t67 = t12 * t66;
    const float t68 = t0 * t67;
    const float t69 = (-2.0f) * t68;
    const float t70 = 1.566f / u[0];
    const float t71 = 17.838802f * t70;
    const float t72 = t71 / t40;
    const float t73 = t72 - t71;
    const float t74 = (-0.5f) * t73;
    const float t75 = t71 + t74;
    const float t76 = t75 / t46;
    const float t77 = 1.3f * t76;
    const float t78 = t38 * t77;
    const float t79 = t26 * t78;
    const float t80 = (-2.0f) * t79;
    const float t81 = t69 - t80;
    const float t82 = t81 / t53;
    const float t83 = t82 + (-1.0f);
    const float t84 = (-3.148f) * t68;
    const float t85 = (-3.132f) * t79;
    const float t86 = t84 + t85;
    const float t87 = 0.00018599696f * t86;
    const float t88 = cosf(t37);
    const float t89 = t28 / u[0];
    const float t90 = 17.838802f * t89;
    const float t91 = t31 * t31;
    const float t92 = 1.0f + t91;
    const float t93 = t90 / t92;
    const float t94 = t90 - t93;
    const float t95 = (-0.5f) * t94;
    const float t96 = t90 - t95;
    const float t97 = t35 * t35;
    const float t98 = 1.0f + t97;
    const float t99 = t96 / t98;
    const float t100 = 1.3f * t99;
    const float t101 = t88 * t100;
    const float t102 = t26 * t101;
    const float t103 = (-2.0f) * t102;
    const float t104 = cosf(t11);
    const float t105 = t2 / u[0];
    const float t106 = 17.886541f * t105;
    const float t107 = t5 * t5;
    const float t108 = 1.0f + t107;
    const float t109 = t106 / t108;
    const float t110 = t109 - t106;
    const float t111 = (-0.5f) * t110;
    const float t112 = t106 + t111;
    const float t113 = t9 * t9;
    const float t114 = 1.0f + t113;
    const float t115 = t112 / t114;
    const float t116 = 1.3f * t115;
    const float t117 = t104 * t116;
    const float t118 = t0 * t117;
    const float t119 = (-2.0f) * t118;
    const float t120 = t103 - t119;
    const float t121 = t120 / t53;
    const float t122 = sinf(t11);
    const float t123 = t0 * t122;
    const float t124 = (-2.0f) * t123;
    const float t125 = sinf(t37);
    const float t126 = t26 * t125;
    const float t127 = (-2.0f) * t126;
    const float t128 = t124 + t127;
    const float t129 = t128 / t53;
    const float t130 = t129 / t53;
    const float t131 = 2335.07f * t130;
    const float t132 = t121 - t131;
    const float t133 = (-3.148f) * t118;
    const float t134 = (-3.132f) * t102;
    const float t135 = t133 + t134;
    const float t136 = 0.00018599696f * t135;
    const float t137 = -t136;
    const float t138 = (-17.886541f) / t108;
    const float t139 = (-17.886541f) - t138;
    const float t140 = (-0.5f) * t139;
    const float t141 = (-17.886541f) - t140;
    const float t142 = t141 / t114;
    const float t143 = 1.3f * t142;
    const float t144 = t104 * t143;
    const float t145 = t0 * t144;
    const float t146 = (-2.0f) * t145;
    const float t147 = t146 / t53;
    const float t148 = (-0.0005855184f) * t145;
    const float t149 = (-17.838802f) / t92;
    const float t150 = (-17.838802f) - t149;
    const float t151 = (-0.5f) * t150;
    const float t152 = (-17.838802f) - t151;
    const float t153 = t152 / t98;
    const float t154 = 1.3f * t153;
    const float t155 = t88 * t154;
    const float t156 = t26 * t155;
    const float t157 = (-2.0f) * t156;
    const float t158 = t157 / t53;
    const float t159 = (-0.0005825425f) * t156;
    const float t160 = -t159;
    const float t161 = (-11424.338f) * t122;
    const float t162 = (-11482.699f) * t125;
    const float t163 = t161 + t162;
    const float t164 = t163 / t53;
    const float t165 = (-17981.906f) * t122;
    const float t166 = (-17981.906f) * t125;
    const float t167 = t165 - t166;
    const float t168 = 0.00018599696f * t167;
    dfdx[0] = t54;
    dfdx[1] = t58;
    dfdx[2] = t83;
    dfdx[3] = t87;
    dfdu[0] = t132;
    dfdu[1] = t137;
    dfdu[2] = t147;
    dfdu[3] = t148;
    dfdu[4] = t158;
    dfdu[5] = t160;
    dfdu[6] = t164;
    dfdu[7] = t168;
}

ARS_SECTION_CODE static void arrange(
    const ars_dynamics_state_t *state, const ars_dynamics_input_t *input, float x[2], float u[4])
{
    const float speed_min = 1.0f; /* m/s */

    x[0] = state->sideslip_angle;
    x[1] = state->yaw_rate;
    u[0] = (input->speed > speed_min) ? input->speed : speed_min;
    u[1] = input->front_angle;
    u[2] = input->rear_angle;
    u[3] = input->friction;
}

/* CasADi stores matrices by columns. */
ARS_SECTION_CODE static ars_dynamics_jacobian_t by_rows(const float dfdx[4], const float dfdu[8])
{
    ars_dynamics_jacobian_t jacobian;
    unsigned int row;
    unsigned int column;

    for (row = 0u; row < 2u; row++) {
        for (column = 0u; column < 2u; column++) {
            jacobian.state[row][column] = dfdx[(2u * column) + row];
        }
        for (column = 0u; column < 4u; column++) {
            jacobian.input[row][column] = dfdu[(2u * column) + row];
        }
    }
    return jacobian;
}

ARS_SECTION_CODE ars_dynamics_state_t ars_dynamics_linear(
    const ars_dynamics_state_t *state, const ars_dynamics_input_t *input)
{
    float x[2];
    float u[4];
    float dx[2];
    ars_dynamics_state_t derivative;

    arrange(state, input, x, u);
    linear_derivative(x, u, dx);
    derivative.sideslip_angle = dx[0];
    derivative.yaw_rate = dx[1];
    return derivative;
}

ARS_SECTION_CODE ars_dynamics_jacobian_t ars_dynamics_linear_jacobian(
    const ars_dynamics_state_t *state, const ars_dynamics_input_t *input)
{
    float x[2];
    float u[4];
    float dfdx[4];
    float dfdu[8];

    arrange(state, input, x, u);
    linear_jacobian(x, u, dfdx, dfdu);
    return by_rows(dfdx, dfdu);
}

ARS_SECTION_CODE ars_dynamics_state_t ars_dynamics_magic_formula(
    const ars_dynamics_state_t *state, const ars_dynamics_input_t *input)
{
    float x[2];
    float u[4];
    float dx[2];
    ars_dynamics_state_t derivative;

    arrange(state, input, x, u);
    magic_formula_derivative(x, u, dx);
    derivative.sideslip_angle = dx[0];
    derivative.yaw_rate = dx[1];
    return derivative;
}

ARS_SECTION_CODE ars_dynamics_jacobian_t ars_dynamics_magic_formula_jacobian(
    const ars_dynamics_state_t *state, const ars_dynamics_input_t *input)
{
    float x[2];
    float u[4];
    float dfdx[4];
    float dfdu[8];

    arrange(state, input, x, u);
    magic_formula_jacobian(x, u, dfdx, dfdu);
    return by_rows(dfdx, dfdu);
}
