{% set n_in, n_out = layers[0].n_in, layers[-1].n_out %}
{% macro read(loop, name) %}{{ name if loop.first else '%s_hidden[%d]' % (name, (loop.index0 - 1) % 2) }}{% endmacro %}
{% macro written(loop, name, output) %}{{ output if loop.last else '%s_hidden[%d]' % (name, loop.index0 % 2) }}{% endmacro %}
{% for layer in layers %}
static void {{ name }}_layer_{{ loop.index }}(const {{ real }} *x, {{ real }} *y
{%- if mirrored %},{{ ' ' if name | length < 12 else '\n    ' }}const {{ real }} *x_image, {{ real }} *y_image{% endif %})
{
    {{ real }} sum[{{ layer.n_out }}] = {0}{{ ', sum_image[%d] = {0}' % layer.n_out if mirrored }};

    for (int i = 0; i < {{ layer.n_in }}; i++)
        for (int k = 0; k < {{ layer.n_out }}; k++) {
            const {{ real }} weight = ({{ real }}){{ layer.weights }}[i][k];
            sum[k] += x[i] * weight;
{% if mirrored %}
            sum_image[k] += x_image[i] * weight;
{% endif %}
        }
    for (int k = 0; k < {{ layer.n_out }}; k++) {
        const {{ real }} bias = ({{ real }}){{ layer.biases }}[k];
        y[k] = {{ 'sum[k] + bias' if loop.last else 'elu(sum[k] + bias)' }};
{% if mirrored %}
        y_image[k] = {{ 'sum_image[k] + bias' if loop.last else 'elu(sum_image[k] + bias)' }};
{% endif %}
    }
}

{% endfor %}
{% if mirrored %}
/* Averages the output with the mirror image of the output for the mirrored input, which makes the
 * network mirror-symmetric. Each layer computes both, so that its weights are loaded once. */
{% endif %}
static void {{ called }}(const {{ real }} x[{{ n_in }}], {{ real }} output[{{ n_out }}])
{
{% if layers | length > 1 %}
    {{ real }} x_hidden[{{ [layers | length - 1, 2] | min }}][{{ n_hidden }}];
{% endif %}
{% if mirrored %}
    {{ real }} image[{{ n_in }}], y[{{ n_out }}], y_image[{{ n_out }}];
{% if layers | length > 1 %}
    {{ real }} image_hidden[{{ [layers | length - 1, 2] | min }}][{{ n_hidden }}];
{% endif %}

    for (int i = 0; i < {{ n_in }}; i++)
        image[i] = x[{{ name | upper }}_INPUT_IMAGE[i]] * ({{ real }}){{ name | upper }}_INPUT_SIGN[i];
{% endif %}
{% for layer in layers %}
    {{ name }}_layer_{{ loop.index }}({{ read(loop, 'x') }}, {{ written(loop, 'x', 'y' if mirrored else 'output') }}
{%- if mirrored %}, {{ read(loop, 'image') }}, {{ written(loop, 'image', 'y_image') }}{% endif %});
{% endfor %}
{% if mirrored %}
    for (int i = 0; i < {{ n_out }}; i++) {
        const {{ real }} sign = ({{ real }}){{ name | upper }}_OUTPUT_SIGN[i];
        output[i] = {{ 0.5 | number }} * (y[i] + y_image[{{ name | upper }}_OUTPUT_IMAGE[i]] * sign);
    }
{% endif %}
}
