#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

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

/* Prints the median of the times by the clock on the wall, and the 99.9th percentile by that of the
 * thread alone: what else the machine does shows in the first. */
static void report(double *wall, double *thread, int count)
{
    qsort(wall, (size_t)count, sizeof(double), ascending);
    qsort(thread, (size_t)count, sizeof(double), ascending);
    printf("%.6f %.6f\n", wall[count / 2], thread[count - 1 - count / 1000]);
}
