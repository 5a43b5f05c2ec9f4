{% for layer in layers %}
static void {{ name }}_layer_{{ loop.index }}(const {{ real }} *restrict x, {{ real }} *restrict y)
{
    for (int k = 0; k < {{ layer.n_out }}; k++)
        y[k] = {{ 0.0 | number }};
    for (int i = 0; i < {{ layer.n_in }}; i++)
        for (int k = 0; k < {{ layer.n_out }}; k++)
            y[k] += x[i] * ({{ real }}){{ layer.weights }}[i][k];
    for (int k = 0; k < {{ layer.n_out }}; k++)
        y[k] {{ '= elu(y[k] + (' if not loop.last else '+= (' }}{{ real }}){{ layer.biases }}[k]{{ ')' if not loop.last }};
}

{% endfor %}
static void {{ name if mirrored else called }}(const {{ real }} input[{{ layers[0].n_in }}], {{ real }} output[{{ layers[-1].n_out }}])
{
{% if layers | length > 1 %}
    {{ real }} hidden[{{ [layers | length - 1, 2] | min }}][{{ n_hidden }}];

{% endif %}
{% for layer in layers %}
    {{ name }}_layer_{{ loop.index }}({{ 'input' if loop.first else 'hidden[%d]' % ((loop.index0 - 1) % 2) }}, {{ 'output' if loop.last else 'hidden[%d]' % (loop.index0 % 2) }});
{% endfor %}
}
{% if mirrored %}

/* What the network says, and what it would say in the mirror, seen in the mirror: their mean
 * treats left and right alike. */
static void {{ called }}(const {{ real }} input[{{ layers[0].n_in }}], {{ real }} output[{{ layers[-1].n_out }}])
{
    {{ real }} image[{{ layers[0].n_in }}], of_image[{{ layers[-1].n_out }}];

    for (int i = 0; i < {{ layers[0].n_in }}; i++)
        image[i] = input[{{ name | upper }}_INPUT_IMAGE[i]] * ({{ real }}){{ name | upper }}_INPUT_SIGN[i];
    {{ name }}(input, output);
    {{ name }}(image, of_image);
    for (int i = 0; i < {{ layers[-1].n_out }}; i++) {
        const {{ real }} sign = ({{ real }}){{ name | upper }}_OUTPUT_SIGN[i];
        output[i] = {{ 0.5 | number }} * (output[i] + of_image[{{ name | upper }}_OUTPUT_IMAGE[i]] * sign);
    }
}
{% endif %}
