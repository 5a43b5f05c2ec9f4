/* {{ name }}.h - {{ title }}.
 *
 * Written by glassgait {{ version }}; {{ name }}.c describes it and how to call it.
 */
#ifndef {{ prefix }}_H
#define {{ prefix }}_H

#ifdef __cplusplus
extern "C" {
#endif

/* The version of glassgait that wrote this file, and digests of gait, policy and estimator. */
#define {{ prefix }}_VERSION "{{ version }}"
#define {{ prefix }}_GAIT "{{ digests[0] }}"
#define {{ prefix }}_POLICY "{{ digests[1] }}"
#define {{ prefix }}_ESTIMATOR "{{ digests[2] }}"

{% for constant, value, note in constants_of_robot %}
#define {{ '%-*s' % (prefix | length + 24, prefix ~ '_' ~ constant ~ ' ' ~ (value | number)) }} /* {{ note }} */
{% endfor %}

/* Order of joints and of feet in every array: front left, front right, rear left, rear right. */
enum {
{% for leg in legs %}
    {{ prefix }}_{{ leg }}_HIP, {{ prefix }}_{{ leg }}_THIGH, {{ prefix }}_{{ leg }}_CALF{{ ',' if not loop.last }}
{% endfor %}
};
enum { {% for leg in legs %}{{ prefix }}_{{ leg }}{{ ', ' if not loop.last }}{% endfor %} };

/* Result of {{ name }}_step: 0, or a sum of these flags. */
enum {
    {{ prefix }}_OK = 0,
    /* A sensor or the estimate is NaN, infinite or beyond 1e6: the memory does not change, and the
     * targets are the previous ones, at first the default stance. */
    {{ prefix }}_BAD_INPUT = 1,
    /* The action is NaN, infinite or beyond 1e6: the targets are the previous ones, and the rest of
     * the memory advances. */
    {{ prefix }}_BAD_TARGET = 2,
    /* A command is outside the gait's range and is clipped to it. If one is not finite, the robot
     * steps on the spot. */
    {{ prefix }}_COMMAND_LIMITED = 4,
    /* {{ name }}_init was never called for this controller: nothing changes, the targets are the
     * default stance. */
    {{ prefix }}_NOT_INITIALISED = 8,
    /* The memory has values that no step leaves, such as NaN or an unknown state: it does not
     * change, and the targets are the default stance. {{ name }}_init resets it. */
    {{ prefix }}_BAD_MEMORY = 16
};

typedef struct {
    {{ real }} joint_position[12]; /* rad */
    {{ real }} joint_velocity[12]; /* rad/s */
    int foot_contact[4]; /* not 0 if a foot presses on the ground now */
{% if has_imu %}
    /* Readings of an IMU in the trunk, x forward, y to the left, z up. */
    {{ real }} angular_velocity[3]; /* rad/s */
    {{ real }} velocity_change[3]; /* acceleration, summed over a step, m/s; at rest 0, 0, {{ '%g' % (period * gravity) }} */
    {{ real }} gravity[3]; /* its direction, a unit vector; 0, 0, -1 if the trunk is level */
{% endif %}
} {{ name }}_sensors;

typedef struct {
    {{ real }} speed;    /* forward, m/s */
    {{ real }} yaw_rate; /* to the left, rad/s */
    {{ real }} dwell;    /* control steps that a state of the gait should last */
} {{ name }}_command;

typedef struct {
    {{ real }} joint_position[12]; /* rad{{ ', within the joints\' ranges' if limits_targets }}, to be held until the next step */
} {{ name }}_targets;

/* The memory of a controller between steps, which {{ name }}_init sets. */
typedef struct {
    unsigned int initialised; /* mark that _init was called */
    {{ real }} action[12]; /* of the previous step: (target - default stance) / {{ action_scale }} rad */
    {{ real }} foot_height[4]; /* estimated at the previous step, m */
    int reading[4]; /* of the contact sensors, at the previous step */
    int unchanged[4]; /* control steps since the last change of each sensor */
    int state; /* of the reward machine: {{ state_names }} */
    int iterations; /* control steps in that state */
    int age; /* control steps since the start */
{% if odometry %}
    int begun; /* whether odometry has taken its first step */
    {{ real }} velocity[3]; /* of the trunk, estimated by odometry, m/s, in the trunk's frame */
    {{ real }} footholds[4][3]; /* where each foot stands, or stood last, m, in the trunk's frame */
    int touching[4]; /* which feet touched at the previous step of odometry */
    {{ real }} turning[3]; /* angular velocity of the trunk at that step, rad/s */
{% endif %}
} {{ name }}_controller;

void {{ name }}_init({{ name }}_controller *controller);

/* Takes one step, to be called every {{ period }} s. Returns {{ prefix }}_OK, or flags. */
int {{ name }}_step({{ name }}_controller *controller, const {{ name }}_sensors *sensors,
    const {{ name }}_command *command, {{ name }}_targets *targets);

#ifdef __cplusplus
}
#endif

#endif
