{{ signature }}
{
    for (int joint = 0; joint < 12; joint++) {
        {{ real }} sum = {{ 0.0 | number }};
        for (int i = 0; i < {{ OWN }}N_OBSERVATIONS; i++)
            sum += observation[i] * ({{ real }}){{ OWN }}WEIGHTS{{ '[state]' if statewise }}[joint][i];
        action[joint] = sum + ({{ real }}){{ OWN }}INTERCEPTS{{ '[state]' if statewise }}[joint];
    }
}
