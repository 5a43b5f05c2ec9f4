static {{ real }} {{ power }}({{ real }} x)
{
    return {{ 'x * x' if power == 'square' else 'x * x * x' }};
}

