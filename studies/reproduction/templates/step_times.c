/* Times a controller's step on sensors drawn at random around the stance. */
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "{{ name }}.c"

enum { COUNT = {{ count }} };

static double now(clockid_t clock)
{
    struct timespec time;
    clock_gettime(clock, &time);
    return 1e6 * (double)time.tv_sec + 1e-3 * (double)time.tv_nsec;
}

static int ascending(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

int main(void)
{
    static double wall[COUNT], thread[COUNT];
    {{ name }}_controller controller;
    {{ name }}_sensors sensors;
    {{ name }}_command command = {.speed = {{ speed }}, .dwell = {{ dwell }}};
    {{ name }}_targets targets;

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
        const double thread_start = now(CLOCK_THREAD_CPUTIME_ID), wall_start = now(CLOCK_MONOTONIC);
        {{ name }}_step(&controller, &sensors, &command, &targets);
        wall[k] = now(CLOCK_MONOTONIC) - wall_start;
        thread[k] = now(CLOCK_THREAD_CPUTIME_ID) - thread_start;
    }
    /* Other load of the machine affects the first number, not the second. */
    qsort(wall, COUNT, sizeof(double), ascending);
    qsort(thread, COUNT, sizeof(double), ascending);
    printf("%.6f %.6f\n", wall[COUNT / 2], thread[COUNT - 1 - COUNT / 1000]);
    return 0;
}
