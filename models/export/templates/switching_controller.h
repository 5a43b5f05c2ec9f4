{% extends 'controller.h' %}
{% block made_of %}
{% for what in ['GAITS', 'POLICIES', 'ESTIMATORS'] %}
#define {{ prefix }}_{{ what }} "{{ gaits | map(attribute='digests') | map(attribute=loop.index0) | join(' ') }}"
{% endfor %}
{% endblock %}
{% block gaits %}
/* The gaits, by their numbers. The first one runs at first. */
enum {
{% for own in gaits %}
    {{ prefix }}_GAIT_{{ own.constant }}{{ ',' if not loop.last }}{{ ' /* %s */' % own.title if own.renamed }}
{% endfor %}
};

{% endblock %}
{% block bad_input %}
    /* A sensor is NaN, infinite or beyond 1e6, or the requested gait has no such number: nothing
     * changes, the targets are those of the step before, at first the default stance. */
{% endblock %}
{% block request %}
    int gait;        /* the gait that is to run, such as {{ prefix }}_GAIT_{{ gaits[-1].constant }} */
{% endblock %}
{% block machine %}
    int gait; /* that runs */
    int state; /* of its machine:
{% for own in gaits %}
                * {{ own.title }}: {{ own.state_names }}{{ ' */' if loop.last }}
{% endfor %}
    int iterations; /* control steps in that state */
    int age; /* control steps since the gait began */
{% endblock %}
