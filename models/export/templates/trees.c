{{ signature }}
{
{% if compared != real %}
    /* The trees were fitted to single-precision numbers, and compare such numbers. */
    {{ compared }} compared[N_OBSERVATIONS];
    for (int i = 0; i < N_OBSERVATIONS; i++)
        compared[i] = ({{ compared }})observation[i];
{% else %}
    const {{ compared }} *const compared = observation;
{% endif %}

    for (int joint = 0; joint < 12; joint++) {
        {{ real }} sum = {{ 0.0 | number }};
        for (int tree = 0; tree < {{ n_trees }}; tree += {{ abreast }}) {
            const {{ question_type }}(*const question)[{{ 2 ** depth - 1 }}] = &QUESTIONS[joint][tree];
            const {{ threshold_type }}(*const threshold)[{{ 2 ** depth - 1 }}] = &THRESHOLDS[joint][tree];
            const {{ leaf_type }}(*const leaf)[{{ 2 ** depth }}] = &LEAVES[joint][tree];
            /* Nodes of {{ abreast }} trees, which are walked down side by side, since each step in a tree
             * waits for the previous one. The children of node k are 2 k + 1 and 2 k + 2. */
            int {% for k in range(abreast) %}n{{ k }} = 0{{ ', ' if not loop.last }}{% endfor %};

            for (int level = 0; level < {{ depth }}; level++) {
{% for k in range(abreast) %}
                n{{ k }} = 2 * n{{ k }} + 1 + (compared[question[{{ k }}][n{{ k }}]] > threshold[{{ k }}][n{{ k }}]);
{% endfor %}
            }
{% for k in range(abreast) %}
            sum += ({{ real }})leaf[{{ k }}][n{{ k }} - {{ 2 ** depth - 1 }}];
{% endfor %}
        }
        action[joint] = sum + ({{ real }})INTERCEPTS[joint];
    }
}
