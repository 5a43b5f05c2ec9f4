{{ signature }}
{
    const int last = {{ n_iterations - 1 }}; /* later control steps take the last entry */
    const int step = (int){{ 'rint' | function }}(observation[{{ OWN }}RM_ITERATIONS] / {{ 0.1 | number }});
    const int place = step < last ? step : last;

    for (int joint = 0; joint < 12; joint++)
        action[joint] = ({{ real }}){{ OWN }}ACTIONS[state][place][joint];
}
