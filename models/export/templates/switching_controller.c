{% extends 'controller.c' %}
{% block made_of %}
 *   {{ '%-20s' % 'gait' }} {{ '%-16s' % 'its machine' }}  {{ '%-16s' % 'policy' }}  estimator of the expert
{% for own in gaits %}
 *   {{ '%-20s' % own.title }} {{ own.digests | join('  ') }}
{% endfor %}
{% endblock %}
{% block diagram %}
 *   feet ----> contacts believed --> machine of the gait that runs <---- heights estimated before
 *                                        |                ^
 *                                        |                +---- requested gait
 *   joints, {{ 'IMU, command, action' if observes_imu else 'command, last action' }} ----> observation ----> {{ 'policy' if odometry else 'estimator ----> policy' }} ----> targets
{% if odometry %}
 *                                        ^
 *   joints, feet, IMU ----> odometry ----+
{% endif %}
{% endblock %}
{% block changes_of_gait %}
 * Gaits: {{ prefix }}_GAIT_{{ gaits[0].constant }} runs at first. Set command.gait to another one at any
 * time; controller.gait tells which one runs. The gait that runs gives way at the stance that ends
 * one of its states and suits the other gait best, or when it has lost its rhythm. {{ 'The' if odometry else 'Estimator and' }}
 * policy {{ "is" if odometry else 'are' }} the other gait's own from that step on; the previous action carries over.
 *
{% endblock %}
{% block states %}
#define PATIENCE {{ patience | number }} /* multiple of the commanded steps after which a gait has lost its rhythm */

enum { N_GAITS = {{ gaits | length }}, STAY = -1 };

/* The states of each gait's machine. */
{% for own in gaits %}
enum { {{ (own.constants | join(', ') ~ ', ' ~ own.own | upper ~ 'N_STATES') | wordwrap(90, wrapstring='\n    ') }} };
{% endfor %}

static const int N_STATES[N_GAITS] = {
    {{ n_states | join(', ') | wordwrap(94, wrapstring='\n    ') }}
};
{% endblock %}
{% block next_state %}
{{ super() }}static int next_state(int gait, int state, const Propositions *now)
{
    switch (gait) {
{% for own in gaits %}
    case {{ prefix }}_GAIT_{{ own.constant }}:{{ ' default:' if loop.last }}
        return {{ own.own }}next_state(state, now);
{% endfor %}
    }
}

/* A stance is the sum of the feet that touch: FL 1, FR 2, RL 4, RR 8. */

/* By gait and stance: feet that touch and should not, or the other way round, to enter a state. */
static const unsigned char DISTANCE[N_GAITS][16] = {
{% for row in distance %}
    {{ '{' }}{{ row | join(', ') }}}, /* {{ gaits[loop.index0].title }} */
{% endfor %}
};

/* The state that is nearest so. */
static const unsigned char ENTERED[N_GAITS][16] = {
{% for row in entered %}
    {{ '{' }}{{ row | join(', ') }}}, /* {{ gaits[loop.index0].title }} */
{% endfor %}
};

/* By the gait that runs and the requested one: the least distance of a stance that ends a state. */
static const unsigned char NEAREST[N_GAITS][N_GAITS] = {
{% for row in nearest %}
    {{ '{' }}{{ row | join(', ') }}}, /* {{ gaits[loop.index0].title }} */
{% endfor %}
};

/* Lets the gait that runs give way to the requested one, if a state has just ended in a stance that
 * is as near to the other gait as any, or if it has lost its rhythm. A gait runs for a step at
 * least. */
static void change_gait(Controller *controller, int requested,
    const Propositions *now, int ended)
{
    const int running = controller->gait;
    int near, overlong, stance = 0;

    if (requested == running || now->age == 0)
        return;
    for (int foot = 0; foot < 4; foot++)
        stance += now->contact[foot] << foot;
    near = DISTANCE[requested][stance] <= NEAREST[running][requested];
    overlong = ({{ real }})controller->iterations >= PATIENCE * now->dwell;
    if (!(ended && near) && !overlong)
        return;
    controller->gait = requested;
    controller->state = ENTERED[requested][stance];
    controller->iterations = 0;
    controller->age = 0;
}

{% endblock %}
{% block begin_of_age %}gait began{% endblock %}
{% block requested %},
    int requested{% endblock %}
{% block where %}controller->gait, controller->state{% endblock %}
{% block change_gait %}
    change_gait(controller, requested, &now, entered != STAY);
{% endblock %}
{% block places %}
enum {
{% for title, start, note in shared_places %}
    {{ '%-28s' % (title ~ ' = ' ~ start ~ (',' if not loop.last)) }}/* {{ note }} */
{% endfor %}
};

/* What stands behind the states of each gait's machine. */
{% for own in gaits %}
enum {
{% for title, start, note in own.places[shared_places | length:] %}
    {{ '%-40s' % (own.own | upper ~ title ~ ' = ' ~ start ~ ',') }}/* {{ note }} */
{% endfor %}
    {{ own.own | upper }}N_OBSERVATIONS = {{ own.n_observations }}
};
{% endfor %}

enum { MOST_OBSERVATIONS = {{ gaits | map(attribute='n_observations') | max }} };

static const int N_OBSERVATIONS[N_GAITS] = {
    {{ n_observations | join(', ') | wordwrap(94, wrapstring='\n    ') }}
};

{% endblock %}
{% block room %}MOST_OBSERVATIONS{% endblock %}
{% block n_states %}
    const int n_states = N_STATES[controller->gait];
{% endblock %}
{% block observed_states %}n_states{% endblock %}
{% block iterations %}RM_STATE + n_states{% endblock %}
{% block commanded_iterations %}RM_STATE + n_states + 1{% endblock %}
{% block estimator_and_policy %}
{% if needs_elu %}
static {{ real }} elu({{ real }} x)
{
    return x > {{ 0.0 | number }} ? x : {{ 'expm1' | function }}(x);
}

{% endif %}
{{ helpers | join }}
{%- for own in gaits %}
/* ---- {{ (own.title ~ ' ' ~ '-' * 90)[:88] }} */

{% if not odometry %}
{{ (own.estimator.title ~ ' It estimates the velocity of the trunk and the heights of the feet from the rest of the observation.') | comment }}

{{ own.estimator.functions }}
{% endif %}
{{ own.policy.title | comment }}

{{ own.policy.functions }}
{% endfor %}
/* ---- The gait that runs ---------------------------------------------------------------------- */

{% if not odometry %}
static void estimate(int gait, {{ real }} observation[MOST_OBSERVATIONS])
{
    switch (gait) {
{% for own in gaits %}
    case {{ prefix }}_GAIT_{{ own.constant }}:{{ ' default:' if loop.last }}
        {{ own.own }}estimate(observation, &observation[{{ own.own | upper }}BASE_VELOCITY]);
        break;
{% endfor %}
    }
}

{% endif %}
static void act(int gait, {{ 'int state, ' if takes_state }}const {{ real }} observation[MOST_OBSERVATIONS],
    {{ real }} action[12])
{
    switch (gait) {
{% for own in gaits %}
    case {{ prefix }}_GAIT_{{ own.constant }}:{{ ' default:' if loop.last }}
        {{ own.own }}act({{ 'state, ' if own.policy.takes_state }}observation, action);
        break;
{% endfor %}
    }
}

{% endblock %}
{% block sound_request %}

        && command->gait >= 0 && command->gait < N_GAITS
{%- endblock %}
{% block sound_state %}controller->gait >= 0 && controller->gait < N_GAITS
        && controller->state >= 0 && controller->state < N_STATES[controller->gait]
{%- endblock %}
{% block limit_change %}
#define GREATEST_CHANGE {{ greatest_change | number }} /* of the action in a step, all joints together */

/* Where a gait begins, its policy may ask for an action far from the last: it goes there as far as
 * one step may go, and on in the next. */
static void limit_change(const {{ real }} last[12], {{ real }} action[12])
{
    {{ real }} change[12], squares[12], sum, length, share;

    for (int joint = 0; joint < 12; joint++) {
        change[joint] = action[joint] - last[joint];
        squares[joint] = change[joint] * change[joint];
    }
    /* In NumPy's order, that of Python's controller: last digits depend on it. */
    sum = ((squares[0] + squares[1]) + (squares[2] + squares[3]))
        + ((squares[4] + squares[5]) + (squares[6] + squares[7]));
    for (int joint = 8; joint < 12; joint++)
        sum += squares[joint];
    length = {{ 'sqrt' | function }}(sum);
    share = GREATEST_CHANGE / (length > {{ 1e-9 | number }} ? length : {{ 1e-9 | number }});
    if (share < {{ 1.0 | number }})
        for (int joint = 0; joint < 12; joint++)
            action[joint] = last[joint] + share * change[joint];
}

{% endblock %}
{% block standing %}
    const Controller standing = {
        .initialised = INITIALISED,
        .reading = {-1, -1, -1, -1}, /* nothing yet */
        .gait = {{ prefix }}_GAIT_{{ gaits[0].constant }},
        .state = {{ initial }},
{% if day %}
        .mode = {{ prefix }}_{{ day.initial }},
{% endif %}
    };
{% endblock %}
{% block begin_anew %}
        next.gait = {{ prefix }}_GAIT_{{ gaits[0].constant }};
        next.state = {{ initial }};
{% endblock %}
{% block observation %}
    {{ real }} observation[MOST_OBSERVATIONS];
{% endblock %}
{% block take %}
    step_machine(&next, contact, within.dwell, command->gait);
    observe(&next, &believed, &within, observation);
{% if odometry %}
    estimate(&next, &believed, &observation[N_OBSERVATIONS[next.gait] - 7]);
    if (!all_sound(observation, N_OBSERVATIONS[next.gait]) || !sound_odometry(&next))
{% else %}
    estimate(next.gait, observation);
    if (!all_sound(observation, N_OBSERVATIONS[next.gait]))
{% endif %}
        return flags | {{ prefix }}_BAD_TARGET{{ ' | stay(controller, targets)' if day }};
{% if day %}
    step_mode(&next, sensors, command->request, go);
    if (!ACTS[next.mode])
        pose(&next, sensors, next.action);
    else
{% endif %}
    {{ '    ' if day }}act(next.gait, {{ 'next.state, ' if takes_state }}observation, next.action);
    if (!all_sound(next.action, 12))
        return flags | {{ prefix }}_BAD_TARGET{{ ' | stay(controller, targets)' if day }};
{% if day %}
    if (ACTS[next.mode])
{% endif %}
    {{ '    ' if day }}limit_change(&observation[PREVIOUS_ACTION], next.action);
    for (int foot = 0; foot < 4; foot++)
        next.foot_height[foot] = observation[N_OBSERVATIONS[next.gait] - 4 + foot];
{% endblock %}
