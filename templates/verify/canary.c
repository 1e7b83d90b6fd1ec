/* A program with a fault for each argument, which working sanitizers find. */
#include <stdio.h>
#include <stdlib.h>
int main(int count, char **arguments)
{
    volatile float number = 1.0e30f;
    volatile float zero = 0.0f;
    float *volatile place = malloc(4u * sizeof(float));

    switch ((count > 1) ? arguments[1][0] : ' ') {
    case 'a': number = place[4]; break;
    case 'c': number = (float)(int)number; break;
    case 'd': number = number / zero; break;
    default: break;
    }
    printf("%g", (double)number);
    free(place);
    return 0;
}
