/* Times a controller's step{{ ', and its two parts,' if n_gaits == 1 }} on sensors drawn at random around the stance. */
{% include "clock.c" %}

#include "{{ name }}.c"

enum { COUNT = {{ count }}, PLACES = {{ 3 if n_gaits == 1 else 1 }} };

#define TIMED(place, call)                                            \
    do {                                                              \
        const double own = now(CLOCK_THREAD_CPUTIME_ID);              \
        const double begun = now(CLOCK_MONOTONIC);                    \
        call;                                                         \
        wall[place][k] = now(CLOCK_MONOTONIC) - begun;                \
        thread[place][k] = now(CLOCK_THREAD_CPUTIME_ID) - own;        \
    } while (0)

int main(void)
{
    static double wall[PLACES][COUNT], thread[PLACES][COUNT];
    {{ name }}_controller controller;
    {{ name }}_sensors sensors;
    {{ name }}_command command = {.speed = {{ speed }}, .dwell = {{ dwell }}};
    {{ name }}_targets targets;
{% if n_gaits == 1 %}
    {{ real }} observation[N_OBSERVATIONS], action[12];
{% endif %}

    {{ name }}_init(&controller);
    for (int k = 0; k < COUNT; k++) {
        for (int joint = 0; joint < 12; joint++) {
            sensors.joint_position[joint] = ({{ real }})(STANCE[joint] + 0.4 * rand() / RAND_MAX - 0.2);
            sensors.joint_velocity[joint] = ({{ real }})(10.0 * rand() / RAND_MAX - 5.0);
        }
        for (int foot = 0; foot < 4; foot++)
            sensors.foot_contact[foot] = rand() > RAND_MAX / 2;
{% if has_imu %}
        for (int axis = 0; axis < 3; axis++) {
            const int up = axis == 2;
            sensors.angular_velocity[axis] = ({{ real }})(2.0 * rand() / RAND_MAX - 1.0);
            sensors.velocity_change[axis] = ({{ real }})(0.2 * up + 0.1 * rand() / RAND_MAX - 0.05);
            sensors.gravity[axis] = ({{ real }})(0.2 * rand() / RAND_MAX - 0.1 - 0.9 * up);
        }
{% endif %}
{% if n_gaits > 1 %}
        command.gait = k / 100 % N_GAITS;
{% endif %}
        TIMED(0, {{ name }}_step(&controller, &sensors, &command, &targets));
{% if n_gaits == 1 %}
        observe(&controller, &sensors, &command, observation);
        TIMED(1, estimate({{ '&controller, &sensors' if has_odometry else 'observation' }}, &observation[BASE_VELOCITY]));
        TIMED(2, act({{ 'controller.state, ' if takes_state }}observation, action));
{% endif %}
    }
    for (int place = 0; place < PLACES; place++)
        report(wall[place], thread[place], COUNT);
    return 0;
}
