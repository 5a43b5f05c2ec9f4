typedef struct {
    {{ real }} FL_hip, FL_thigh, FL_calf, FR_hip, FR_thigh, FR_calf;
    {{ real }} RL_hip, RL_thigh, RL_calf, RR_hip, RR_thigh, RR_calf;
} Joints;

/* Returns what is observed of the joints in its own unit. What counts from the default stance has
 * all of it added, from_stance 1, and the rest nothing, from_stance 0. */
static Joints joints(const {{ real }} observed[12], {{ real }} scale, {{ real }} from_stance)
{
    const Joints own = {
{% for joint in joints %}
        .{{ joint }} = observed[{{ joint | upper }}] / scale + from_stance * STANCE[{{ joint | upper }}],
{% endfor %}
    };
    return own;
}

