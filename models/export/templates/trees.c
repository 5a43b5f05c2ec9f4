static void act(const {{ real }} observation[N_OBSERVATIONS], {{ real }} action[12])
{
{% if compared != real %}
    /* The trees were grown on numbers of single precision, and compare such numbers. */
    {{ compared }} compared[N_OBSERVATIONS];
    for (int i = 0; i < N_OBSERVATIONS; i++)
        compared[i] = ({{ compared }})observation[i];
{% else %}
    const {{ compared }} *const compared = observation;
{% endif %}

    for (int joint = 0; joint < 12; joint++) {
        {{ real }} sum = {{ 0.0 | number }};
        /* Some trees are walked down side by side, since each waits for what it reads. */
        for (int tree = 0; tree < {{ n_trees }}; tree += {{ abreast }}) {
            int node[{{ abreast }}] = {0}; /* the children of node k are 2 k + 1 and 2 k + 2 */
            for (int level = 0; level < {{ depth }}; level++) {
                for (int k = 0; k < {{ abreast }}; k++) {
                    const {{ question_type }} *const questions = QUESTIONS[joint][tree + k];
                    const {{ threshold_type }} *const thresholds = THRESHOLDS[joint][tree + k];
                    const int right = compared[questions[node[k]]] > thresholds[node[k]];
                    node[k] = 2 * node[k] + 1 + right;
                }
            }
            for (int k = 0; k < {{ abreast }}; k++)
                sum += ({{ real }})LEAVES[joint][tree + k][node[k] - {{ 2 ** depth - 1 }}];
        }
        action[joint] = sum + ({{ real }})INTERCEPTS[joint];
    }
}
