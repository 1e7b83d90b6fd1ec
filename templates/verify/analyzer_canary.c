/* A fault that gcc -fanalyzer must find. */
int analyzer_canary(int count);
int analyzer_canary(int count)
{
    int *nowhere = 0;
    if (count > 7) {
        return *nowhere;
    }
    return count;
}
