typedef struct { {{ real }} x, y, z; } Axes;

