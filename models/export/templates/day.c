/* ---- Day: rise, stand, walk, lie down; damped when anything is wrong ------------------------- */

enum { N_MODES = {{ day.modes | length }} };

#define SPEED {{ day.day.speed | number }} /* m/s, beyond which a command is to go */
#define YAW_RATE {{ day.day.yaw_rate | number }} /* rad/s, the same */
#define LEANING {{ day.upright | number }} /* gravity's upward part beyond which the trunk leans by {{ '%g' % day.day.lean }} degrees */
#define LEVEL {{ day.level | number }} /* up to which it leans by {{ '%g' % day.day.level }} degrees at most */
#define TURNING {{ day.day.turning | number }} /* rad/s about each axis, up to which the trunk is slow */
#define JOINT_SPEED {{ day.day.joint_speed | number }} /* rad/s, root mean square, up to which joints are */
#define HALTED {{ day.halted }} /* control steps without a command to go */
#define BLIND {{ day.blind }} /* control steps without sound readings */
#define BEYOND {{ beyond | number }} /* rad past its range, where a joint's reading is not sound */

/* Control steps in which joints go to the mode's posture. */
static const int MODE_STEPS[N_MODES] = { {{- day.modes | map(attribute='steps') | join(', ') -}} };

/* Whether the policy acts in a mode, and whether joints are damped alone. */
static const int ACTS[N_MODES] = { {{- day.modes | map(attribute='acts') | map('int') | join(', ') -}} };
static const int DAMPS[N_MODES] = { {{- day.modes | map(attribute='damps') | map('int') | join(', ') -}} };

/* The postures, as actions: 0 is the default stance. */
static const {{ real }} POSTURE[N_MODES][12] = {
{% for mode in day.modes %}
    { {{- mode.goal.tolist() | map('number') | join(', ') | wordwrap(92, wrapstring='\n     ') -}} }, /* {{ mode.title }} */
{% endfor %}
};

/* What modes are left by. */
typedef struct {
    int {{ day.propositions | join(', ') }};
} Signs;

/* {{ day.fault[0] }} */
static int is_wrong(const Signs *now)
{
    return {{ day.fault[1] | join('\n        ') }};
}

static int next_mode(int mode, const Signs *now)
{
    if (is_wrong(now))
        return {{ prefix }}_{{ day.fault[2] }};
    switch (mode) {
{% for case in day.cases %}
    case {{ prefix }}_{{ case.state }}:
{% for formula, condition, target in case.exits %}
        /* {{ formula }} */
        if ({{ condition | join('\n            ') }})
            return {{ prefix }}_{{ target }};
{% endfor %}
        break;
{% endfor %}
    default:
        break;
    }
    return mode;
}

static int is_slow(const Sensors *sensors)
{
    {{ real }} sum = {{ 0.0 | number }};

    for (int axis = 0; axis < 3; axis++)
        if ({{ 'fabs' | function }}(sensors->angular_velocity[axis]) > TURNING)
            return 0;
    for (int joint = 0; joint < 12; joint++)
        sum += sensors->joint_velocity[joint] * sensors->joint_velocity[joint];
    return sum <= {{ 12.0 | number }} * (JOINT_SPEED * JOINT_SPEED);
}

static int count_up(int steps)
{
    return steps < LONGEST ? steps + 1 : LONGEST;
}

static void enter_mode(Controller *controller, int mode)
{
    if (mode == controller->mode) {
        controller->mode_steps = count_up(controller->mode_steps);
        return;
    }
    controller->mode = mode;
    controller->mode_steps = 0;
    for (int joint = 0; joint < 12; joint++)
        controller->begin[joint] = controller->action[joint];
}

static void step_mode(Controller *controller, const Sensors *sensors, int request, int go)
{
    const Signs now = {
{% for request in day.requests %}
        .{{ request }} = request == {{ prefix }}_REQUEST_{{ request | upper }},
{% endfor %}
        .go = go,
        .halted = controller->idle >= HALTED,
        .done = controller->mode_steps >= MODE_STEPS[controller->mode],
        .leaning = sensors->gravity[2] > LEANING,
        .level = sensors->gravity[2] <= LEVEL,
        .slow = is_slow(sensors),
        .blind = controller->unsound > BLIND,
    };

    enter_mode(controller, next_mode(controller->mode, &now));
    controller->idle = go ? 0 : count_up(controller->idle);
    controller->unsound = 0;
}

/* Without sound readings nothing is known but for how long. */
static void step_blindly(Controller *controller)
{
    const Signs now = {.blind = controller->unsound > BLIND};

    const int wrong = now.blind && is_wrong(&now);

    enter_mode(controller, wrong ? {{ prefix }}_{{ day.fault[2] }} : controller->mode);
    controller->idle = count_up(controller->idle);
    controller->unsound = count_up(controller->unsound);
}

/* Sends joints to the mode's posture, at rest at both ends, or to where they are, which damps them
 * alone. */
static void pose(const Controller *controller, const Sensors *sensors, {{ real }} action[12])
{
    const int mode = controller->mode, steps = MODE_STEPS[mode] > 1 ? MODE_STEPS[mode] : 1;
    const {{ real }} elapsed = ({{ real }})controller->mode_steps / ({{ real }})steps;
    const {{ real }} s = elapsed < {{ 1.0 | number }} ? elapsed : {{ 1.0 | number }};
    const {{ real }} share = s * s * ({{ 3.0 | number }} - {{ 2.0 | number }} * s);

    for (int joint = 0; joint < 12; joint++) {
        const {{ real }} begin = controller->begin[joint];

        action[joint] = DAMPS[mode]
            ? (sensors->joint_position[joint] - STANCE[joint]) / ACTION_SCALE
            : begin + share * (POSTURE[mode][joint] - begin);
    }
}

static int sound_readings(const Sensors *sensors)
{
    const {{ real }} *g = sensors->gravity;
    const {{ real }} square = g[0] * g[0] + g[1] * g[1] + g[2] * g[2];

    for (int joint = 0; joint < 12; joint++) {
        const {{ real }} position = sensors->joint_position[joint];

        if (position < LOWEST[{{ limit }}] - BEYOND || position > HIGHEST[{{ limit }}] + BEYOND)
            return 0;
    }
    return square >= {{ least_gravity | number }} && square <= {{ greatest_gravity | number }};
}

static int sound_mode(const Controller *controller)
{
    return controller->mode >= 0 && controller->mode < N_MODES
        && controller->mode_steps >= 0 && controller->mode_steps <= LONGEST
        && controller->idle >= 0 && controller->idle <= LONGEST
        && controller->unsound >= 0 && controller->unsound <= LONGEST
        && all_sound(controller->begin, 12);
}

