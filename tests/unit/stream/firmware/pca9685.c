#include "pca9685.h"
#include <string.h>

enum { BOARDS = 62, OUTPUTS = 16, MODE1 = 0, MODE2 = 1, LED0 = 6, ALL_LED = 0xFA, PRESCALE = 0xFE };
enum { INCREMENT = 0x20, SLEEP = 0x10, TOTEM_POLE = 0x04, FULL = 0x10 };

typedef struct {
  uint8_t registers[256];
  uint8_t active[4 * OUTPUTS]; /* values of this cycle: new ones count from the next one on */
  uint64_t cycle, end;         /* this cycle; PCA_NEVER: asleep */
  uint64_t rising[OUTPUTS], falling[OUTPUTS];
} Board;

static Board boards[BOARDS];
static unsigned present = 1;
static double clock_hz = 25e6;
static int oe = 1, made;
static void (*told)(unsigned, uint64_t, uint64_t);

static void power_up(Board *board) {
  memset(board, 0, sizeof *board);
  board->registers[MODE1] = SLEEP | 1;
  board->registers[MODE2] = TOTEM_POLE;
  board->registers[PRESCALE] = 0x1E;
  for (unsigned k = 0; k < OUTPUTS; k++) {
    board->registers[LED0 + 4 * k + 3] = FULL;
    board->rising[k] = board->falling[k] = PCA_NEVER;
  }
  board->cycle = board->end = PCA_NEVER;
}

static void make(void) {
  if (made) return;
  made = 1;
  for (unsigned b = 0; b < BOARDS; b++) power_up(&boards[b]);
}

static uint64_t count_ps(const Board *board) { return (uint64_t)((board->registers[PRESCALE] + 1) / clock_hz * 1e12); }

static void cut(Board *board, unsigned k, uint64_t now) {
  if (board->rising[k] <= now && told) told((unsigned)(board - boards) * OUTPUTS + k, board->rising[k], now);
  board->rising[k] = board->falling[k] = PCA_NEVER;
}

static void begin_cycle(Board *board, uint64_t now) {
  board->cycle = now;
  board->end = now + 4096 * count_ps(board);
  memcpy(board->active, board->registers + LED0, sizeof board->active);
  for (unsigned k = 0; k < OUTPUTS; k++) {
    const uint8_t *led = board->active + 4 * k;
    unsigned on = led[0] | (led[1] & 15u) << 8, off = led[2] | (led[3] & 15u) << 8;
    if (led[3] & FULL || oe || off <= on) continue;
    board->rising[k] = now + on * count_ps(board);
    board->falling[k] = now + off * count_ps(board);
  }
}

static void store(Board *board, uint8_t at, uint8_t value, uint64_t now) {
  if (at == PRESCALE && !(board->registers[MODE1] & SLEEP)) return; /* it can be set asleep only */
  if (at >= ALL_LED && at < ALL_LED + 4) {
    for (unsigned k = 0; k < OUTPUTS; k++) board->registers[LED0 + 4 * k + (at - ALL_LED)] = value;
    return;
  }
  board->registers[at] = value;
  if (at != MODE1) return;
  if (value & SLEEP) {
    for (unsigned k = 0; k < OUTPUTS; k++) cut(board, k, now);
    board->cycle = board->end = PCA_NEVER;
  } else if (board->end == PCA_NEVER) {
    board->end = now + 500000000ull; /* the oscillator needs 500 us */
  }
}

void pca_boards(unsigned count) {
  make();
  for (unsigned b = count; b < present; b++) power_up(&boards[b]); /* what loses its supply forgets */
  present = count;
}

void pca_clock(double hz) { clock_hz = hz; }

int pca_write(uint64_t now, uint8_t address, const uint8_t *bytes, unsigned size) {
  make();
  unsigned b = address - 0x40u;
  if (b >= present || b >= BOARDS || !size) return 0;
  uint8_t at = bytes[0];
  for (unsigned k = 1; k < size; k++) {
    store(&boards[b], at, bytes[k], now);
    if (boards[b].registers[MODE1] & INCREMENT) at++;
  }
  return 1;
}

void pca_oe(uint64_t now, int level) {
  make();
  oe = level;
  if (level) for (unsigned b = 0; b < BOARDS; b++) for (unsigned k = 0; k < OUTPUTS; k++) cut(&boards[b], k, now);
}

uint64_t pca_next(void) {
  uint64_t first = PCA_NEVER;
  for (unsigned b = 0; made && b < present; b++) {
    if (boards[b].end < first) first = boards[b].end;
    for (unsigned k = 0; k < OUTPUTS; k++) if (boards[b].falling[k] < first) first = boards[b].falling[k];
  }
  return first;
}

void pca_pass(uint64_t now, void (*ended)(unsigned channel, uint64_t start, uint64_t end)) {
  told = ended;
  for (unsigned b = 0; made && b < present; b++) {
    for (unsigned k = 0; k < OUTPUTS; k++) if (boards[b].falling[k] <= now) cut(&boards[b], k, boards[b].falling[k]);
    if (boards[b].end <= now) begin_cycle(&boards[b], boards[b].end);
  }
}

uint8_t pca_register(unsigned board, uint8_t at) {
  make();
  return boards[board].registers[at];
}
