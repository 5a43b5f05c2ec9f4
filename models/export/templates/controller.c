/* {{ name }}.c - {{ title }}.
 *
 * From what a {{ robot }}'s joints{{ ',' if has_imu else ' and' }} feet{{ ' and IMU' if has_imu }} sense to the targets of its joints,
 * {{ rate }} times a second. It reads no other sensor, needs only math.h, and takes no memory of its own.
 *
 *   gait       {{ '%-28s' % gait_name }} {{ digests[0] }}
 *   policy     {{ '%-28s' % policy_name }} {{ digests[1] }}
 *   estimator  {{ '%-28s' % ('odometry' if odometry else 'of the expert') }} {{ digests[2] }}
 *   numbers    {{ real }}
 *
 * Made by glassgait {{ version }}. Edit the policy and export it anew rather than this file.
 *
 * One step:
 *
 *   feet ----> contacts believed ------> machine <-------- heights estimated at the step before
 *                                        |
 *   joints, {{ 'IMU, command, action' if observes_imu else 'command, last action' }} ----> observation ----> {{ 'policy' if odometry else 'estimator ----> policy' }} ----> targets
{% if odometry %}
 *                                        ^
 *   joints, feet, IMU ----> odometry ----+
{% endif %}
 *
 * Compile:  cc -O2 -std=c99 -ffp-contract=off -c {{ name }}.c     (link with -lm)
 * Call:
 *
 *   {{ name }}_controller controller;
 *   {{ name }}_init(&controller);
 *   every {{ period }} s:
 *       status = {{ name }}_step(&controller, &sensors, &command, &targets);
 *       torque = {{ stiffness }} * (targets.joint_position - position) - {{ damping }} * velocity
 *
 * -ffp-contract=off keeps a product and a sum two operations, as they are where the policy was
 * made; without it last digits differ on some machines.
 *
{% if limits_targets %}
{% if limits %}
 * Targets stay within the joints' ranges, move by so much in a step and ask for so much torque,
 * whatever the policy asks for: see Limits.
{% else %}
 * Targets stay within the joints' ranges, however far beyond the policy asks them to be.
{% endif %}
{% else %}
 * Targets may lie beyond the range of a joint: that is how the policy asks for torque.
{% endif %}
 */
#include "{{ name }}.h"

#include <math.h>

#ifdef __FAST_MATH__
#error "-ffast-math takes the checks for NaN away; compile without it"
#endif

typedef {{ name }}_controller Controller;
typedef {{ name }}_sensors Sensors;
typedef {{ name }}_command Command;
typedef {{ name }}_targets Targets;

enum { FL, FR, RL, RR };

enum {
{% for leg in legs %}
    {{ leg }}_HIP, {{ leg }}_THIGH, {{ leg }}_CALF{{ ',' if not loop.last }}
{% endfor %}
};

{% macro of_joints(name, values) %}
static const {{ real }} {{ name }}[12] = {
{% for leg in legs %}
    {{ values[3 * loop.index0:][:3] | map('number') | join(', ') }}, /* {{ leg }} hip, thigh, calf */
{% endfor %}
};
{% endmacro %}
/* The default stance, rad: observed positions and actions are counted from it. */
{{ of_joints('STANCE', stance) }}
{% if limits_targets %}
{% if lowest | length == 3 %}
/* The ranges of every leg's hip, thigh and calf, rad: targets stay within. */
static const {{ real }} LOWEST[3] = { {{- lowest | map('number') | join(', ') -}} };
static const {{ real }} HIGHEST[3] = { {{- highest | map('number') | join(', ') -}} };
{% else %}
/* The ranges of the joints, rad: targets stay within. */
{{ of_joints('LOWEST', lowest) }}{{ of_joints('HIGHEST', highest) }}
{%- endif %}

{% endif %}
#define ACTION_SCALE {{ action_scale | number }} /* rad of joint target for an action of 1 */
#define LARGEST {{ 1000000.0 | number }} /* greatest size of a sensible number, in any unit here */
#define INITIALISED 0x{{ '%08X' % mark }} /* what a controller holds that {{ name }}_init has set */

{% if arrays %}
/* The numbers of {{ named }}, which stand at the end of this file. */
{% for array in arrays %}
{{ '%-40s' % (array.declaration ~ ';') }} /* {{ array.note }} */
{% endfor %}

{% endif %}
{% if odometry %}
/* ---- Estimate: odometry, how fast the trunk is and how high its feet are --------------------- */

{{ odometry }}
{% endif %}
/* ---- Contacts: which sensors are believed ---------------------------------------------------- */

#define UNCHANGED {{ unchanged_steps }} /* control steps after which a sensor that reads the same is not believed */
#define LOW {{ low | number }} /* m, below which the foot of such a sensor is taken to touch */

{% if odometry %}
/* Writes how high the feet are, by the ground of the step before, carried along. */
static void expect_heights(const Controller *controller, const Sensors *sensors, {{ real }} height[4])
{
    const {{ real }} *v = controller->velocity, *w = controller->turning;
    Controller carried = *controller;
    {{ real }} turned[3];
    Foot feet[4];

    for (int leg = 0; leg < 4; leg++) {
        feet[leg] = foot_of(
            leg, &sensors->joint_position[3 * leg], &sensors->joint_velocity[3 * leg]);
        cross(w, controller->footholds[leg], turned);
        for (int axis = 0; axis < 3; axis++)
            carried.footholds[leg][axis] -= PERIOD * (v[axis] + turned[axis]);
    }
    measure_heights(&carried, feet, height);
}

{% endif %}
/* Reads the contact sensors, and takes the heights of feet whose sensors seem to be stuck. Writes
 * which feet the machine takes to touch: the memory of one step bridges a bouncing touch-down. */
static void believe_contacts(Controller *controller, Sensors *sensors, int contact[4])
{
    {{ real }} height[4] = {0};
    int doubted = 0;

    for (int foot = 0; foot < 4; foot++) {
        const int reading = sensors->foot_contact[foot] != 0;
        int *unchanged = &controller->unchanged[foot];

        contact[foot] = reading || controller->reading[foot] == 1;
        if (reading != controller->reading[foot])
            *unchanged = 0;
        else if (*unchanged < UNCHANGED)
            *unchanged += 1;
        controller->reading[foot] = reading;
        doubted |= *unchanged == UNCHANGED;
    }
    if (!doubted)
        return;
{% if odometry %}
    if (controller->begun)
        expect_heights(controller, sensors, height);
{% else %}
    for (int foot = 0; foot < 4; foot++)
        height[foot] = controller->foot_height[foot];
{% endif %}
    for (int foot = 0; foot < 4; foot++)
        if (controller->unchanged[foot] == UNCHANGED)
            sensors->foot_contact[foot] = contact[foot] = height[foot] < LOW;
}

/* ---- Reward machine: where in the gait the robot is ------------------------------------------ */

#define CLEARANCE {{ gait.clearance | number }} /* m, how high feet must be that a transition wants in the air */
#define LONGEST 1000000000 /* control steps that are counted */

enum { {{ constants | join(', ') }}, N_STATES, STAY };

/* What a transition asks for. */
typedef struct {
    int contact[4];   /* whether each foot touches, now or at the step before */
{% for field, note in [('height[4];', 'of each foot, as estimated at the step before, m'), ('dwell;', 'commanded control steps in a state')] %}
    {{ '%-17s' % (real ~ ' ' ~ field) }} /* {{ note }} */
{% endfor %}
    int spent;        /* control steps in the state, with this one */
    int age;          /* control steps since the start */
} Propositions;

/* Returns the state that is entered, or STAY. */
static int next_state(int state, const Propositions *now)
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

static void step_machine(Controller *controller, const int contact[4], {{ real }} dwell)
{
    Propositions now;
    int entered;

    for (int foot = 0; foot < 4; foot++) {
        now.contact[foot] = contact[foot];
        now.height[foot] = controller->foot_height[foot];
    }
    now.dwell = dwell;
    now.spent = controller->iterations + 1;
    now.age = controller->age;

    entered = next_state(controller->state, &now);
    if (entered != STAY)
        controller->state = entered;
    controller->iterations = entered != STAY ? 0 : now.spent < LONGEST ? now.spent : LONGEST;
    controller->age += controller->age < LONGEST;
}

{{ '/* ---- Observation: what the policy sees ------------------------------------------------------- */' if odometry else '/* ---- Observation: what the estimator and the policy see -------------------------------------- */' }}

enum {
{% for title, start, note in places %}
    {{ '%-28s' % (title ~ ' = ' ~ start ~ ',') }}/* {{ note }} */
{% endfor %}
    N_OBSERVATIONS = {{ n_observations }}
};

#define OVERDUE {{ overdue | number }} /* control steps by which the observed time may pass the commanded one */

static {{ real }} nearest({{ real }} value, {{ real }} least, {{ real }} greatest) /* to a value, in a range */
{
    return value < least ? least : value > greatest ? greatest : value;
}

/* Writes all but what is estimated. */
static void observe(const Controller *controller, const Sensors *sensors, const Command *command,
    {{ real }} observation[N_OBSERVATIONS])
{
    const {{ real }} spent = ({{ real }})controller->iterations;
    const {{ real }} longest = command->dwell + OVERDUE;

    observation[COMMAND_X] = command->speed;
    observation[COMMAND_YAW] = command->yaw_rate;
    for (int joint = 0; joint < 12; joint++) {
        observation[JOINT_POSITION + joint] = sensors->joint_position[joint] - STANCE[joint];
        observation[JOINT_VELOCITY + joint] = sensors->joint_velocity[joint] * {{ 0.05 | number }};
{% if limits_targets %}
        observation[PREVIOUS_ACTION + joint] = nearest(controller->action[joint],
            (LOWEST[{{ limit }}] - STANCE[joint]) / ACTION_SCALE,
            (HIGHEST[{{ limit }}] - STANCE[joint]) / ACTION_SCALE);
{% else %}
        observation[PREVIOUS_ACTION + joint] = controller->action[joint];
{% endif %}
    }
{% if observes_imu %}
    for (int axis = 0; axis < 3; axis++) {
        observation[GRAVITY_DIRECTION + axis] = sensors->gravity[axis];
        observation[ANGULAR_VELOCITY + axis] = sensors->angular_velocity[axis] * {{ 0.25 | number }};
    }
{% endif %}
    for (int state = 0; state < N_STATES; state++)
        observation[RM_STATE + state] = state == controller->state ? {{ 1.0 | number }} : {{ 0.0 | number }};
    observation[RM_ITERATIONS] = (spent < longest ? spent : longest) * {{ 0.1 | number }};
    observation[COMMAND_RM_ITERATIONS] = command->dwell * {{ 0.1 | number }};
}

{% if not odometry %}
/* ---- Estimate: a network --------------------------------------------------------------------- */

{{ (estimator.title ~ ' It estimates the velocity of the trunk and the heights of the feet from the rest of the observation.') | comment }}

{% endif %}
{% if needs_elu %}
static {{ real }} elu({{ real }} x)
{
    return x > {{ 0.0 | number }} ? x : {{ 'expm1' | function }}(x);
}

{% endif %}
{% if not odometry %}
{{ estimator.functions }}
{% endif %}
/* ---- Policy: from the observation to the action ---------------------------------------------- */

{{ policy.title | comment }}

{{ policy.functions }}
{% if limits %}
/* ---- Limits: what comes last, whatever the policy asks for ----------------------------------- */

#define UPRIGHT {{ limits.upright | number }} /* gravity's upward part where the trunk leans by {{ '%g' % limits.lean }} degrees */
#define MARGIN {{ limits.margin | number }} /* rad, that targets stay away from the ends of the joints' ranges */

/* How far targets may be from joints, and from those before, rad: from there a joint at rest asks
 * its motor for all that it has. */
{% if reach | length == 3 %}
static const {{ real }} REACH[3] = { {{- reach | map('number') | join(', ') -}} };
{% else %}
{{ of_joints('REACH', reach) }}
{%- endif %}

static void limit(const Controller *controller, const Sensors *sensors, {{ real }} action[12])
{
    for (int joint = 0; joint < 12; joint++) {
        const {{ real }} here = (sensors->joint_position[joint] - STANCE[joint]) / ACTION_SCALE;
        const {{ real }} before = controller->action[joint], reach = REACH[{{ limit }}] / ACTION_SCALE;
        /* A joint that is sent to where it is, is damped alone. */
        {{ real }} target = sensors->gravity[2] < UPRIGHT ? action[joint] : here;

        target = nearest(target, here - reach, here + reach);
        target = nearest(target, before - reach, before + reach);
        action[joint] = nearest(target, (LOWEST[{{ limit }}] + MARGIN - STANCE[joint]) / ACTION_SCALE,
            (HIGHEST[{{ limit }}] - MARGIN - STANCE[joint]) / ACTION_SCALE);
    }
}

{% endif %}
/* ---- Controller ------------------------------------------------------------------------------ */

static int all_sound(const {{ real }} *values, int count)
{
    for (int i = 0; i < count; i++)
        if (!({{ 'fabs' | function }}(values[i]) <= LARGEST)) /* true of NaN as well */
            return 0;
    return 1;
}

static int sound_input(const Sensors *sensors)
{
    return all_sound(sensors->joint_position, 12)
        && all_sound(sensors->joint_velocity, 12){% if has_imu %}

        && all_sound(sensors->angular_velocity, 3) && all_sound(sensors->velocity_change, 3)
        && all_sound(sensors->gravity, 3){% endif %};
}

static int sound_counts(const Controller *controller)
{
    for (int foot = 0; foot < 4; foot++)
        if (controller->unchanged[foot] < 0 || controller->unchanged[foot] > UNCHANGED)
            return 0;
    return 1;
}

{% if odometry %}
/* Returns whether what odometry remembers is something that a step may have left. */
static int sound_odometry(const Controller *controller)
{
    for (int leg = 0; leg < 4; leg++)
        if (!all_sound(controller->footholds[leg], 3))
            return 0;
    return all_sound(controller->velocity, 3) && all_sound(controller->turning, 3);
}

{% endif %}
/* Returns whether a controller remembers what a step may have left. */
static int sound_memory(const Controller *controller)
{
    return all_sound(controller->action, 12) && all_sound(controller->foot_height, 4)
        && controller->state >= 0 && controller->state < N_STATES
        && controller->iterations >= 0 && controller->iterations <= LONGEST
        && controller->age >= 0 && controller->age <= LONGEST && sound_counts(controller)
{%- if odometry %}

        && sound_odometry(controller)
{%- endif %};
}

static {{ real }} limited({{ real }} value, {{ real }} least, {{ real }} greatest, int *flags)
{
    if (!(value >= least && value <= greatest))
        *flags |= {{ prefix }}_COMMAND_LIMITED;
    return nearest(value, least, greatest);
}

static void set_targets(const {{ real }} action[12], Targets *targets)
{
{% if limits_targets %}
    for (int joint = 0; joint < 12; joint++)
        targets->joint_position[joint] = nearest(STANCE[joint] + ACTION_SCALE * action[joint],
            LOWEST[{{ limit }}], HIGHEST[{{ limit }}]);
{% else %}
    for (int joint = 0; joint < 12; joint++)
        targets->joint_position[joint] = STANCE[joint] + ACTION_SCALE * action[joint];
{% endif %}
}

void {{ name }}_init(Controller *controller)
{
    const Controller standing = {
        .initialised = INITIALISED,
        .reading = {-1, -1, -1, -1}, /* nothing yet */
        .state = {{ initial }},
    };

    *controller = standing;
}

int {{ name }}_step(
    Controller *controller, const Sensors *sensors, const Command *command, Targets *targets)
{
    static const {{ real }} standing[12] = {0}; /* the action that asks for the default stance */
    Controller next;
    Sensors believed;
    Command within;
    {{ real }} observation[N_OBSERVATIONS];
    int contact[4], flags = {{ prefix }}_OK;

    set_targets(standing, targets);
    if (controller->initialised != INITIALISED)
        return {{ prefix }}_NOT_INITIALISED;
    if (!sound_memory(controller))
        return {{ prefix }}_BAD_MEMORY;
    next = *controller;

    /* Until all is known to be sound, the targets are those of the step before. */
    set_targets(controller->action, targets);
    if (!sound_input(sensors))
        return {{ prefix }}_BAD_INPUT;
    within = *command;
    /* Where a command is not finite the robot is to step on the spot. */
    if (!isfinite(within.speed) || !isfinite(within.yaw_rate) || !isfinite(within.dwell)) {
        flags |= {{ prefix }}_COMMAND_LIMITED;
        within.speed = within.yaw_rate = {{ 0.0 | number }};
        within.dwell = {{ (gait.dwell | sum // 2) | float | number }};
    }
    within.speed = limited(within.speed,
        -{{ prefix }}_MAX_SPEED, {{ prefix }}_MAX_SPEED, &flags);
    within.yaw_rate = limited(within.yaw_rate,
        -{{ prefix }}_MAX_YAW_RATE, {{ prefix }}_MAX_YAW_RATE, &flags);
    within.dwell = limited(within.dwell,
        {{ prefix }}_MIN_DWELL, {{ prefix }}_MAX_DWELL, &flags);

    believed = *sensors;
    believe_contacts(&next, &believed, contact);
    step_machine(&next, contact, within.dwell);
    observe(&next, &believed, &within, observation);
{% if odometry %}
    estimate(&next, &believed, &observation[BASE_VELOCITY]);
    if (!all_sound(&observation[BASE_VELOCITY], 7) || !sound_odometry(&next))
{% else %}
    estimate(observation, &observation[BASE_VELOCITY]);
    if (!all_sound(&observation[BASE_VELOCITY], 7))
{% endif %}
        return flags | {{ prefix }}_BAD_INPUT;
    for (int foot = 0; foot < 4; foot++)
        next.foot_height[foot] = observation[FOOT_HEIGHT + foot];

    act({{ 'next.state, ' if takes_state }}observation, next.action);
    if (!all_sound(observation, N_OBSERVATIONS) || !all_sound(next.action, 12)) {
        /* Time goes on, and the joints keep their targets. */
        for (int joint = 0; joint < 12; joint++)
            next.action[joint] = controller->action[joint];
        flags |= {{ prefix }}_BAD_TARGET;
    }{% if limits %} else {
        limit(controller, sensors, next.action);
    }
{% else %}

{% endif %}
    *controller = next;
    set_targets(controller->action, targets);
    return flags;
}
{% if arrays %}

/* ---- The numbers ----------------------------------------------------------------------------- */
{% for array in arrays %}

/* {{ array.note }} */
{{ array.definition }}
{% endfor %}
{% endif %}
