{{ signature }}
{
    for (int joint = 0; joint < 12; joint++) {
        {{ real }} sum = {{ 0.0 | number }};
        for (int i = 0; i < N_OBSERVATIONS; i++)
            sum += observation[i] * ({{ real }})WEIGHTS{{ '[state]' if per_state }}[joint][i];
        action[joint] = sum + ({{ real }})INTERCEPTS{{ '[state]' if per_state }}[joint];
    }
}
