/* libmodbus as the master of a board: reads, runs it to a target, changes the target, stops it.
 *
 *     gcc -o board tests/clients/board.c -lmodbus
 *     board TERMINAL UNIT
 *     board HOST:PORT UNIT
 *
 * Numbers are put together here: modbus_set_float_abcd of libmodbus 3.1.6 swaps their bytes. */

#include <errno.h>
#include <math.h>
#include <modbus/modbus.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

enum { CONTROL = 0, KIND = 1, STATUS = 4, AMPLITUDE = 34, FREQUENCY = 100, READY = 1, RUNS = 1 << 1, HELD = 1 << 8 };

static modbus_t *master;

static void check(int right, const char *what)
{
    if (!right) {
        fprintf(stderr, "%s: %s\n", what, modbus_strerror(errno));
        exit(1);
    }
}

/* On a busy machine a frame may be interrupted, and is then no request. It is repeated. */
enum { ATTEMPTS = 10 };

static int write_words(int address, int count, const uint16_t *words)
{
    int tries = ATTEMPTS, done;
    do
        done = modbus_write_registers(master, address, count, words);
    while (done == -1 && errno == ETIMEDOUT && --tries);
    return done;
}

static int read_words(int address, int count, uint16_t *words)
{
    int tries = ATTEMPTS, done;
    do
        done = modbus_read_registers(master, address, count, words);
    while (done == -1 && errno == ETIMEDOUT && --tries);
    return done;
}

static float number(int address)
{
    uint16_t words[2];
    float value;
    check(read_words(address, 2, words) == 2, "number");
    uint32_t bits = (uint32_t)words[0] << 16 | words[1];
    memcpy(&value, &bits, sizeof value);
    return value;
}

static void set_target(uint16_t kind, float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    const uint16_t words[] = {kind, bits >> 16, bits & 0xffff};
    check(write_words(KIND, 3, words) == 3, "target");
}

static void set_control(uint16_t word)
{
    check(write_words(CONTROL, 1, &word) == 1, "control word");
}

static void wait_for(uint16_t bits, uint16_t value)
{
    time_t end = time(NULL) + 100;
    uint16_t status;
    do {
        check(time(NULL) < end, "no such status");
        usleep(50000);
        check(read_words(STATUS, 1, &status) == 1, "status");
    } while ((status & bits) != value);
}

int main(int count, char **words)
{
    check(count == 3, "board TERMINAL|HOST:PORT UNIT");
    char *port = strchr(words[1], ':');
    if (port) {
        *port = '\0';
        master = modbus_new_tcp(words[1], atoi(port + 1));
    } else {
        /* A terminal without a line has no parity. */
        master = modbus_new_rtu(words[1], 19200, 'N', 8, 1);
    }
    check(master && modbus_set_slave(master, atoi(words[2])) == 0, "master");
    modbus_set_response_timeout(master, 5, 0);
    check(modbus_connect(master) == 0, words[1]);

    check(number(FREQUENCY) == 50, "frequency");
    uint16_t none, unknown[] = {49, 0, 0}, words_60[] = {0x4270, 0};
    check(read_words(99, 1, &none) == -1 && errno == EMBXILADD, "register 99");
    check(write_words(KIND, 3, unknown) == -1 && errno == EMBXILVAL, "kind 49");
    wait_for(READY, READY);
    set_control(0);
    set_target(32, 0.8f);
    set_control(1);
    wait_for(HELD, HELD);
    check(write_words(FREQUENCY, 2, words_60) == -1 && errno == EMBXSBUSY, "frequency");
    set_target(33, 0.1f);
    time_t end = time(NULL) + 100;
    while (fabsf(number(AMPLITUDE) - 0.1f) >= 0.005f)
        check(time(NULL) < end, "amplitude");
    wait_for(HELD, HELD);
    printf("libmodbus: held 0.8 of k, then %.3f mm\n", number(AMPLITUDE));
    set_control(0);
    wait_for(RUNS, 0);
    modbus_close(master);
    modbus_free(master);
    return 0;
}
