/* Returns the state that is entered, or STAY. */
static int {{ own }}next_state(int state, const Propositions *now)
{
    switch (state) {
{% for case in cases %}
    case {{ case.state }}:
{% for formula, condition, target in case.exits %}
        /* {{ formula }} */
        if ({{ condition | join('\n            ') }})
            return {{ target }};
{% endfor %}
        break;
{% endfor %}
    default:
        break;
    }
    return STAY;
}
