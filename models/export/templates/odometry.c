#define GAIN {{ gain | number }} /* share of the standing feet in the trunk's velocity, each step */
#define PERIOD {{ period | number }} /* s between two steps */
#define GRAVITY {{ gravity | number }} /* m/s^2 */
#define SLIP {{ slip | number }} /* m/s over the ground, at which a foot no longer stands */

/* Lengths of the legs, m. OFFSET is positive on the left and negative on the right. */
#define THIGH {{ thigh | number }} /* from the thigh joint to the knee */
#define CALF {{ calf | number }} /* from the knee to the foot's centre */
#define RADIUS {{ radius | number }} /* of a foot */
static const {{ real }} OFFSET[4] = { {{- offset | map('number') | join(', ') -}} }; /* of the thigh joint */
static const {{ real }} HIP[4][3] = { /* the hip joint, from the trunk's centre */
{% for leg in legs %}
    {{ '{' }}{{ hip[loop.index0] | map('number') | join(', ') }}}{{ ',' if not loop.last }} /* {{ leg }} */
{% endfor %}
};

/* In the trunk's frame: position of a foot, its velocity and its shank's angular velocity. */
typedef struct {
    {{ real }} p[3], dp[3], dr[3]; /* m, m/s, rad/s */
} Foot;

/* Computes a leg's foot from the angles and velocities of its hip, thigh and calf. */
static Foot foot_of(int leg, const {{ real }} q[3], const {{ real }} dq[3])
{
    const {{ real }} shank = q[1] + q[2], turning = dq[1] + dq[2];
    const {{ real }} sin_hip = {{ 'sin' | function }}(q[0]), cos_hip = {{ 'cos' | function }}(q[0]);
    /* In the plane of the leg, forward and up from the thigh joint. */
    const {{ real }} x = -THIGH * {{ 'sin' | function }}(q[1]) - CALF * {{ 'sin' | function }}(shank);
    const {{ real }} z = -THIGH * {{ 'cos' | function }}(q[1]) - CALF * {{ 'cos' | function }}(shank);
    const {{ real }} dx = -THIGH * {{ 'cos' | function }}(q[1]) * dq[1] - CALF * {{ 'cos' | function }}(shank) * turning;
    const {{ real }} dz = THIGH * {{ 'sin' | function }}(q[1]) * dq[1] + CALF * {{ 'sin' | function }}(shank) * turning;
    /* The hip turns that plane about the trunk's forward axis. */
    const {{ real }} left = cos_hip * OFFSET[leg] - sin_hip * z;
    const {{ real }} up = sin_hip * OFFSET[leg] + cos_hip * z;
    const Foot foot = {
        .p = {HIP[leg][0] + x, HIP[leg][1] + left, HIP[leg][2] + up},
        .dp = {dx, -up * dq[0] - sin_hip * dz, left * dq[0] + cos_hip * dz},
        .dr = {dq[0], cos_hip * turning, sin_hip * turning},
    };
    return foot;
}

static void cross(const {{ real }} a[3], const {{ real }} b[3], {{ real }} product[3])
{
    product[0] = a[1] * b[2] - a[2] * b[1];
    product[1] = a[2] * b[0] - a[0] * b[2];
    product[2] = a[0] * b[1] - a[1] * b[0];
}

/* Returns the feet that touch now and did one step before, since a foot that just came down still
 * moves. Feet that swing or slip are left out, unless all do: then the prediction is wrong. */
static unsigned standing_feet(const Controller *controller, const Sensors *sensors,
    const {{ real }} predicted[3], {{ real }} soles[4][3])
{
    unsigned stood = 0, near = 0;

    for (int leg = 0; leg < 4; leg++) {
        {{ real }} square = {{ 0.0 | number }};

        for (int axis = 0; axis < 3; axis++) {
            const {{ real }} over = soles[leg][axis] + predicted[axis];
            square += over * over;
        }
        if (sensors->foot_contact[leg] && controller->touching[leg]) {
            stood |= 1u << leg;
            near |= (unsigned)(square < SLIP * SLIP) << leg;
        }
    }
    return near ? near : stood;
}

/* Predicts the velocity by the accelerometer, and corrects it by the standing feet. Feet roll: the
 * lowest point of a foot, its sole, is at rest, not its centre. */
static void advance_velocity(Controller *controller, const Sensors *sensors, const Foot feet[4])
{
    const {{ real }} *w = sensors->angular_velocity, *dv = sensors->velocity_change;
    const {{ real }} *g = sensors->gravity;
    {{ real }} *v = controller->velocity, turned[3], turning[3], rolled[3];
    {{ real }} predicted[3], soles[4][3], of_feet[3] = {0};
    unsigned standing;
    int count = 0;

    cross(w, v, turned);
    for (int axis = 0; axis < 3; axis++) {
        const {{ real }} free = dv[axis] + PERIOD * GRAVITY * g[axis];
        predicted[axis] = v[axis] - PERIOD * turned[axis] + free;
    }
    for (int leg = 0; leg < 4; leg++) {
        for (int axis = 0; axis < 3; axis++)
            turning[axis] = w[axis] + feet[leg].dr[axis];
        cross(w, feet[leg].p, turned);
        cross(turning, g, rolled);
        for (int axis = 0; axis < 3; axis++)
            soles[leg][axis] = feet[leg].dp[axis] + turned[axis] + RADIUS * rolled[axis];
    }
    standing = standing_feet(controller, sensors, predicted, soles);
    for (int leg = 0; leg < 4; leg++) {
        if (!(standing >> leg & 1))
            continue;
        for (int axis = 0; axis < 3; axis++)
            of_feet[axis] += soles[leg][axis];
        count++;
    }
    for (int axis = 0; axis < 3; axis++) {
        v[axis] = predicted[axis];
        if (count > 0)
            v[axis] += GAIN * (-of_feet[axis] / ({{ real }})count - predicted[axis]);
    }
}

/* Sets the footholds of feet that touch, and moves those of the other feet with the ground. */
static void carry_footholds(Controller *controller, const Sensors *sensors, const Foot feet[4])
{
    const {{ real }} *v = controller->velocity, *w = sensors->angular_velocity;
    {{ real }} turned[3];

    for (int leg = 0; leg < 4; leg++) {
        {{ real }} *at = controller->footholds[leg];

        cross(w, at, turned);
        for (int axis = 0; axis < 3; axis++)
            if (sensors->foot_contact[leg])
                at[axis] = feet[leg].p[axis];
            else
                at[axis] -= PERIOD * (v[axis] + turned[axis]);
        controller->touching[leg] = sensors->foot_contact[leg] != 0;
    }
    for (int axis = 0; axis < 3; axis++)
        controller->turning[axis] = w[axis];
}

/* Writes the feet's heights above the plane through the mean of the footholds, whose normal is the
 * cross product of their diagonals. */
static void measure_heights(const Controller *controller, const Foot feet[4], {{ real }} height[4])
{
    const {{ real }}(*at)[3] = controller->footholds;
    {{ real }} first[3], second[3], normal[3], mean[3], length;

    for (int axis = 0; axis < 3; axis++) {
        first[axis] = at[FR][axis] - at[RL][axis];
        second[axis] = at[FL][axis] - at[RR][axis];
        mean[axis] = (at[FL][axis] + at[FR][axis] + at[RL][axis] + at[RR][axis]) / {{ 4.0 | number }};
    }
    cross(first, second, normal);
    length = {{ 'sqrt' | function }}(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
    for (int leg = 0; leg < 4; leg++) {
        height[leg] = {{ 0.0 | number }};
        for (int axis = 0; axis < 3; axis++)
            height[leg] += (feet[leg].p[axis] - mean[axis]) * (normal[axis] / length);
    }
}

/* Advances by a step, or begins with a robot at rest on all feet, and writes the observations:
 * twice the velocity, then the heights. */
static void estimate(
    Controller *controller, const Sensors *sensors, {{ real }} body[7])
{
    Foot feet[4];

    for (int leg = 0; leg < 4; leg++)
        feet[leg] = foot_of(
            leg, &sensors->joint_position[3 * leg], &sensors->joint_velocity[3 * leg]);
    if (controller->begun) {
        advance_velocity(controller, sensors, feet);
        carry_footholds(controller, sensors, feet);
    } else {
        for (int leg = 0; leg < 4; leg++)
            for (int axis = 0; axis < 3; axis++)
                controller->footholds[leg][axis] = feet[leg].p[axis];
        controller->begun = 1;
    }
    for (int axis = 0; axis < 3; axis++)
        body[axis] = {{ 2.0 | number }} * controller->velocity[axis];
    measure_heights(controller, feet, &body[3]);
}
