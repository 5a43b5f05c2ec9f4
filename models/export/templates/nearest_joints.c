/* Returns the joints nearest to these in ranges of hips, thighs and calves; of right hips, whose
 * angles have the other sign, these are those of left ones in the mirror. */
static Joints nearest_joints(Joints own, {{ real }} hip_low, {{ real }} hip_high,
    {{ real }} thigh_low, {{ real }} thigh_high, {{ real }} calf_low, {{ real }} calf_high)
{
    const Joints read = {
{% for joint in joints %}
{% if joint.endswith('R_hip') %}
        .{{ joint }} = nearest(own.{{ joint }}, -hip_high, -hip_low),
{% else %}
        .{{ joint }} = nearest(own.{{ joint }}, {{ joint[3:] }}_low, {{ joint[3:] }}_high),
{% endif %}
{% endfor %}
    };
    return read;
}

