typedef struct { {{ real }} {{ legs | join(', ') }}; } Feet;

