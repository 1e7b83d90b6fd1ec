"""C loops over the units of a build, for `units`; REAL is the build's number type."""

DECLARATIONS = {
    "map": """
void probe_map(const REAL *speed, const REAL *front_angle, const REAL *friction, REAL *reference, uint32_t count);
""",
    "limiter": """
void probe_limiter(ars_limiter_t *self, const ars_limiter_parameters_t *parameters, const REAL *inputs, REAL *angles,
                   uint32_t count);
""",
    "reference_model": """
void probe_model_from(const REAL *from, const REAL *inputs, REAL *states, uint32_t count);
void probe_model_start(const REAL *inputs, REAL *states, uint32_t count);
""",
}
DEFINITIONS = {
    "map": """
void probe_map(const REAL *speed, const REAL *front_angle, const REAL *friction, REAL *reference, uint32_t count)
{
    for (uint32_t k = 0u; k < count; k++) {
        const ars_map_reference_t found = ars_map_reference(speed[k], front_angle[k], friction[k]);
        reference[4u * k] = found.yaw_rate;
        reference[4u * k + 1u] = found.rear_angle;
        reference[4u * k + 2u] = found.lateral_acceleration_max;
        reference[4u * k + 3u] = ars_map_yaw_rate_on_road(speed[k], front_angle[k], friction[k]);
    }
}
""",
    "limiter": """
void probe_limiter(ars_limiter_t *self, const ars_limiter_parameters_t *parameters, const REAL *inputs, REAL *angles,
                   uint32_t count)
{
    for (uint32_t k = 0u; k < count; k++) {
        ars_limiter_input_t input;
        memcpy(&input, &inputs[3u * k], sizeof(input));
        angles[k] = ars_limiter_step(self, parameters, &input);
    }
}
""",
    "reference_model": """
void probe_model_from(const REAL *from, const REAL *inputs, REAL *states, uint32_t count)
{
    for (uint32_t k = 0u; k < count; k++) {
        ars_reference_model_t self;
        ars_reference_model_input_t input;
        memcpy(&self, &from[k * (sizeof(self) / sizeof(REAL))], sizeof(self));
        memcpy(&input, &inputs[4u * k], sizeof(input));
        ars_reference_model_step(&self, &input);
        memcpy(&states[k * (sizeof(self) / sizeof(REAL))], &self, sizeof(self));
    }
}
void probe_model_start(const REAL *inputs, REAL *states, uint32_t count)
{
    for (uint32_t k = 0u; k < count; k++) {
        ars_reference_model_t self;
        ars_reference_model_start(&self, inputs[3u * k], inputs[3u * k + 1u], inputs[3u * k + 2u]);
        memcpy(&states[k * (sizeof(self) / sizeof(REAL))], &self, sizeof(self));
    }
}
""",
}
