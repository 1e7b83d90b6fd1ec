/* Faults that cppcheck and its MISRA addon must find. */
int canary(int count);
int canary(int count)
{
    const int pair[2] = { 0, 0 };
    if (count > 017) {
        goto end;
    }
    return pair[2];
end:
    return count;
}
