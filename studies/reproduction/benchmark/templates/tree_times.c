/* Times trees on observations that robots made, and writes down what they give. */
{% include "clock.c" %}

#include "{{ source }}"

enum { COUNT = {{ count }}, N_ROWS = {{ n_rows }}, N_COLUMNS = {{ n_columns }} };

int main(void)
{
    static double rows[N_ROWS][N_COLUMNS], wall[COUNT], thread[COUNT];
    double action[12];
{% if tl2cgen %}
    static const double intercepts[12] = {{ '{' }}{{ intercepts | join(', ') }}{{ '}' }};
{% endif %}
    FILE *const given = fopen("observations.bin", "rb"), *const out = fopen("actions.bin", "wb");

    if (!given || !out || fread(rows, sizeof rows, 1, given) != 1)
        return 1;
    for (int k = 0; k < COUNT; k++) {
{% if tl2cgen %}
        union Entry entries[N_COLUMNS];
        for (int i = 0; i < N_COLUMNS; i++)
            entries[i].fvalue = rows[k % N_ROWS][i];
        /* Its sums begin with what is there. */
        memcpy(action, intercepts, sizeof action);
{% endif %}
        const double own = now(CLOCK_THREAD_CPUTIME_ID), begun = now(CLOCK_MONOTONIC);
        {{ 'predict(entries, 0, action)' if tl2cgen else 'act(rows[k % N_ROWS], action)' }};
        wall[k] = now(CLOCK_MONOTONIC) - begun;
        thread[k] = now(CLOCK_THREAD_CPUTIME_ID) - own;
        if (k < N_ROWS && fwrite(action, sizeof action, 1, out) != 1)
            return 1;
    }
    if (fclose(out))
        return 1;
    report(wall, thread, COUNT);
    return 0;
}
