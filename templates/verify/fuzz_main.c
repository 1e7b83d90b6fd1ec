/*
 * Run a fuzz harness with a fixed number of inputs: mutations of its seeds and of inputs that reached new edges.
 *
 * Arguments: harness, file of seeds (each with its length in four bytes), number of inputs, seed of the random numbers.
 * The same arguments give the same inputs. Prints the numbers of inputs, of the corpus and of edges.
 */
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int fuzz_can(const uint8_t *data, size_t size);
int fuzz_step(const uint8_t *data, size_t size);
int fuzz_main(int count, char **arguments);
void __sanitizer_cov_trace_pc(void);

enum { INPUT_BYTES_MAX = 2048, CORPUS_MAX = 4096, EDGES = 1 << 16, CHANGES_MAX = 6 };

typedef struct {
    uint8_t *data;
    size_t size;
} input_t;

static int (*harness)(const uint8_t *data, size_t size) = fuzz_can;
static input_t corpus[CORPUS_MAX];
static uint32_t corpus_size;
static uint64_t random_state;
static unsigned long input_number;

/* Passes of each edge in this input, the list of these edges, and the most passes so far, in powers of two. */
static uint8_t counts[EDGES];
static uint16_t touched[EDGES];
static uint32_t touched_size;
static uint8_t seen[EDGES];
static uint32_t edges;

void __sanitizer_cov_trace_pc(void)
{
    /* Relative, because the program is loaded at another address in each run. */
    const uintptr_t place = (uintptr_t)__builtin_return_address(0) - (uintptr_t)&fuzz_main;
    const uint32_t edge = (uint32_t)(((uint64_t)place * 0x9E3779B97F4A7C15u) >> 48u);

    if (counts[edge] == 0u) {
        touched[touched_size] = (uint16_t)edge;
        touched_size++;
    }
    if (counts[edge] < UINT8_MAX) {
        counts[edge]++;
    }
}

/* S. Vigna, An experimental exploration of Marsaglia's xorshift generators, scrambled, 2016: xorshift64*. */
static uint32_t below(uint32_t limit)
{
    random_state ^= random_state >> 12u;
    random_state ^= random_state << 25u;
    random_state ^= random_state >> 27u;
    return (uint32_t)(((random_state * 0x2545F4914F6CDD1Du) >> 32u) % limit);
}

static void keep(const uint8_t *data, size_t size)
{
    if (corpus_size < CORPUS_MAX) {
        uint8_t *const copy = malloc((size > 0u) ? size : 1u);

        if (copy == NULL) {
            abort();
        }
        memcpy(copy, data, size);
        corpus[corpus_size].data = copy;
        corpus[corpus_size].size = size;
        corpus_size++;
    }
}

/* Run an input. Returns whether an edge was passed for the first time, or more often than before. */
static int run(const uint8_t *data, size_t size)
{
    /* A separate allocation, so that sanitizers detect accesses beyond the input. */
    uint8_t *const copy = malloc((size > 0u) ? size : 1u);
    int news = 0;
    uint32_t k;

    if (copy == NULL) {
        abort();
    }
    memcpy(copy, data, size);
    input_number++;
    (void)harness(copy, size);
    free(copy);
    for (k = 0u; k < touched_size; k++) {
        const uint32_t edge = touched[k];
        uint8_t magnitude = 1u;

        while ((counts[edge] >> magnitude) != 0u) {
            magnitude++;
        }
        edges += (seen[edge] == 0u) ? 1u : 0u;
        if (magnitude > seen[edge]) {
            seen[edge] = magnitude;
            news = 1;
        }
        counts[edge] = 0u;
    }
    touched_size = 0u;
    return news;
}

static size_t spliced(uint8_t *data, size_t size)
{
    const input_t *const other = &corpus[below(corpus_size)];
    size_t length;
    size_t from;
    size_t to;

    if (other->size == 0u) {
        return size;
    }
    from = below((uint32_t)other->size);
    length = 1u + below((uint32_t)(other->size - from));
    to = below((uint32_t)size + 1u);
    length = (length < (INPUT_BYTES_MAX - to)) ? length : (INPUT_BYTES_MAX - to);
    memcpy(&data[to], &other->data[from], length);
    return ((to + length) > size) ? (to + length) : size;
}

static size_t changed(uint8_t *data, size_t size)
{
    /* Special numbers: quiet and signalling NaN, infinity, the smallest and the largest. */
    static const uint32_t special[] = { 0x7FC00000u, 0x7F800001u, 0x7F800000u, 0xFF800000u, 0x00000001u, 0x7F7FFFFFu, 0x80000000u, 0u };
    static const uint8_t bytes[] = { 0x00u, 0x01u, 0x7Fu, 0x80u, 0xFFu };
    size_t result = size;
    size_t at;
    size_t length;

    if (size == 0u) {
        return spliced(data, size);
    }
    at = below((uint32_t)size);
    switch (below(9u)) {
    case 0u:
    case 1u:
        data[at] ^= (uint8_t)(1u << below(8u));
        break;
    case 2u:
        data[at] = (uint8_t)below(256u);
        break;
    case 3u:
        data[at] = bytes[below(sizeof(bytes))];
        break;
    case 4u:
        data[at] = (uint8_t)(data[at] + below(17u) - 8u);
        break;
    case 5u:
        if ((at + 4u) <= size) {
            memcpy(&data[at], &special[below(sizeof(special) / sizeof(special[0]))], 4u);
        }
        break;
    case 6u: /* remove bytes */
        length = 1u + below((uint32_t)(size - at));
        memmove(&data[at], &data[at + length], size - at - length);
        result = size - length;
        break;
    case 7u: /* duplicate bytes */
        length = 1u + below(16u);
        if ((size + length) <= INPUT_BYTES_MAX) {
            memmove(&data[at + length], &data[at], size - at);
            result = size + length;
        }
        break;
    default:
        result = spliced(data, size);
        break;
    }
    return result;
}

static void read_seeds(const char *path)
{
    FILE *const file = fopen(path, "rb");
    uint32_t size;
    static uint8_t data[INPUT_BYTES_MAX];

    if (file == NULL) {
        exit(3);
    }
    while (fread(&size, sizeof(size), 1u, file) == 1u) {
        if ((size == 0u) || (size > INPUT_BYTES_MAX) || (fread(data, size, 1u, file) != 1u)) {
            exit(3);
        }
        keep(data, size);
    }
    (void)fclose(file);
}

static void report_abort(int number)
{
    (void)number;
    (void)fprintf(stderr, "at input %lu\n", input_number);
    _Exit(6);
}

int fuzz_main(int count, char **arguments)
{
    static uint8_t data[INPUT_BYTES_MAX];
    unsigned long inputs;
    uint32_t k;

    if (count != 5) {
        return 2;
    }
    if (strcmp(arguments[1], "step") == 0) {
        harness = fuzz_step;
    }
    (void)signal(SIGABRT, report_abort);
    inputs = strtoul(arguments[3], NULL, 10);
    random_state = strtoull(arguments[4], NULL, 10) + 1u;
    read_seeds(arguments[2]);
    if (corpus_size == 0u) {
        return 3;
    }
    for (k = 0u; (k < corpus_size) && (input_number < inputs); k++) {
        (void)run(corpus[k].data, corpus[k].size);
    }
    while (input_number < inputs) {
        const input_t *const parent = &corpus[below(corpus_size)];
        size_t size = parent->size;

        memcpy(data, parent->data, size);
        for (k = 1u + below(CHANGES_MAX); k > 0u; k--) {
            size = changed(data, size);
        }
        if (run(data, size) != 0) {
            keep(data, size);
        }
    }
    (void)printf("%lu %u %u\n", input_number, (unsigned int)corpus_size, (unsigned int)edges);
    return 0;
}
