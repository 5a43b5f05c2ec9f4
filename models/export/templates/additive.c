/* Returns the number of cuts that do not exceed a value. */
static int bin_of({{ real }} value, const {{ cut_type }} *cuts, int n_cuts)
{
    int low = 0;

    while (n_cuts > 0) {
        const int half = n_cuts / 2;
        if (value >= ({{ real }})cuts[low + half]) {
            low += half + 1;
            n_cuts -= half + 1;
        } else {
            n_cuts = half;
        }
    }
    return low;
}

{{ signature }}
{
{% if n_pairs %}
    {{ real }} of_pairs[12] = {0};
    int bins[N_OBSERVATIONS];

{% endif %}
    for (int joint = 0; joint < 12; joint++)
        action[joint] = {{ 0.0 | number }};
    for (int i = 0; i < N_OBSERVATIONS; i++) {
        const int bin = bin_of(observation[i], CUTS[i], {{ n_cuts }});
        for (int joint = 0; joint < 12; joint++)
            action[joint] += ({{ real }})EFFECTS[i][bin][joint];
    }
    for (int joint = 0; joint < 12; joint++)
        action[joint] += ({{ real }})INTERCEPTS[joint];
{% if n_pairs %}

    for (int i = 0; i < N_OBSERVATIONS; i++)
        bins[i] = bin_of(observation[i], PAIR_CUTS[i], {{ n_pair_cuts }});
    for (int pair = 0; pair < {{ n_pairs }}; pair++) {
        const int first = bins[PAIRS[pair][0]], second = bins[PAIRS[pair][1]];
        of_pairs[PAIRS[pair][2]] += ({{ real }})PAIR_EFFECTS[pair][first][second];
    }
    for (int joint = 0; joint < 12; joint++)
        action[joint] += of_pairs[joint];
{% endif %}
}
