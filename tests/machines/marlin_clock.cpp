#ifdef __PLAT_LINUX__
#include "../../inc/MarlinConfig.h"
#include "../shared/Delay.h"
#include "hardware/Timer.h"
#include "../../module/motion.h"
#if HAS_SERVOS
#include "../../module/servo.h"
void servo_wait() { constexpr uint16_t d[] = SERVO_DELAY; safe_delay(d[0]); }
#endif
#include <ucontext.h>
#include <unistd.h>
#include <string.h>
extern void setup(); extern void loop();
extern Timer timers[2];
uint64_t vt_now = 0;
static uint64_t until_ns, next_rx, next_tx; static bool in_isr;
static ucontext_t host, fw; static char stack[8 << 20];
static uint8_t rx[1 << 16]; static uint32_t rx_n, rx_i; static uint8_t tx[1 << 20]; static uint32_t tx_n;
static int32_t phys[3], *way; static uint32_t way_n, way_cap; static int32_t sw[3];
static const uint64_t BYTE = 10000000000ull / BAUDRATE;
struct Axis : Peripheral {
  int a; pin_type en, dir, step, mn;
  Axis(int a, pin_type en, pin_type dir, pin_type step, pin_type mn) : a(a), en(en), dir(dir), step(step), mn(mn) { Gpio::attachPeripheral(step, this); }
  void update() override { Gpio::pin_map[mn].value = phys[a] <= sw[a]; }
  void interrupt(GpioEvent ev) override {
    if (ev.event != GpioEvent::RISE || Gpio::pin_map[en].value) return;
    const bool inv[3] = { INVERT_X_DIR, INVERT_Y_DIR, INVERT_Z_DIR };
    phys[a] += (Gpio::pin_map[dir].value != inv[a]) ? 1 : -1; update();
    if (way_n + 3 > way_cap) { way_cap = way_cap ? 2 * way_cap : 1 << 16; way = (int32_t*)realloc(way, 4 * way_cap); }
    memcpy(way + way_n, phys, 12); way_n += 3;
  }
};
static Axis *axes[3];
static void deliver() {
  while (rx_i < rx_n && next_rx <= vt_now && usb_serial.receive_buffer.free()) {
    uint8_t c = rx[rx_i++]; next_rx = vt_now + BYTE;
    TERN_(EMERGENCY_PARSER, emergency_parser.update(usb_serial.emergency_state, c));
    usb_serial.receive_buffer.write(c);
  }
  while (usb_serial.transmit_buffer.available() && next_tx <= vt_now) { if (tx_n < sizeof tx) tx[tx_n++] = usb_serial.transmit_buffer.read(); next_tx = vt_now + BYTE; }
}
void vt_pass(uint64_t ns) {
  if (in_isr) { vt_now += ns; return; }
  const uint64_t end = vt_now + ns;
  for (;;) {
    uint64_t t = end; int which = -1;
    for (int i = 0; i < 2; i++) if (timers[i].active && timers[i].due < t) { t = timers[i].due; which = i; }
    if (t < vt_now) t = vt_now;
    if (t > until_ns) { if (vt_now < until_ns) vt_now = until_ns; deliver(); swapcontext(&fw, &host); for (auto a : axes) if (a) a->update(); continue; }
    vt_now = t;
    if (which >= 0) { in_isr = true; timers[which].fire(); in_isr = false; }
    deliver();
    if (vt_now >= end) return;
  }
}
void vt_stop() { timers[0].active = timers[1].active = false; }
void vt_poll() { vt_pass(50000); }
static void begin() {
  Clock::setFrequency(F_CPU); HAL_timer_init();
  axes[0] = new Axis(0, X_ENABLE_PIN, X_DIR_PIN, X_STEP_PIN, X_MIN_PIN);
  axes[1] = new Axis(1, Y_ENABLE_PIN, Y_DIR_PIN, Y_STEP_PIN, Y_MIN_PIN);
  axes[2] = new Axis(2, Z_ENABLE_PIN, Z_DIR_PIN, Z_STEP_PIN, Z_MIN_PIN);
  for (auto a : axes) a->update();
  vt_pass(10000000); setup(); for (;;) { loop(); vt_poll(); }
}
static bool all(void *b, size_t n) { char *p = (char*)b; while (n) { ssize_t k = read(0, p, n); if (k <= 0) return false; p += k; n -= k; } return true; }
static void put(const void *b, size_t n) { const char *p = (const char*)b; while (n) { ssize_t k = write(1, p, n); if (k <= 0) _exit(1); p += k; n -= k; } }
#pragma pack(push,1)
struct Ask { double seconds; int32_t sw[3], contact; uint8_t forced, buttons; uint32_t n; };
struct Tell { int32_t phys[3]; uint8_t pwm_on, ocr, motors_off, state; uint32_t tx_n, way_n; double now; };
#pragma pack(pop)
int main(int argc, char **argv) {
  if (argc > 1 && chdir(argv[1])) {}
  for (int a = 0; a < 3; a++) { phys[a] = argc > 2 + a ? atoi(argv[2 + a]) : 0; sw[a] = -(1 << 30); }
  getcontext(&fw); fw.uc_stack.ss_sp = stack; fw.uc_stack.ss_size = sizeof stack; fw.uc_link = nullptr; makecontext(&fw, begin, 0);
  Ask q; double owed = 0;
  while (all(&q, sizeof q)) {
    for (int a = 0; a < 3; a++) sw[a] = q.sw[a] == 1 << 30 ? -(1 << 30) : q.sw[a];
    if (rx_i == rx_n) rx_i = rx_n = 0; else if (rx_i) { memmove(rx, rx + rx_i, rx_n - rx_i); rx_n -= rx_i; rx_i = 0; }
    if (rx_n + q.n > sizeof rx) _exit(3);
    if (!all(rx + rx_n, q.n)) break; rx_n += q.n;
    owed += q.seconds * 1e9; uint64_t k = owed; owed -= k; until_ns += k; tx_n = way_n = 0;
    swapcontext(&host, &fw);
    Tell r = { { phys[0], phys[1], phys[2] }, 0, 0, Gpio::pin_map[X_ENABLE_PIN].value != 0, 0, tx_n, way_n, vt_now / 1e9 };
    #if HAS_SERVOS
      r.pwm_on = servo[0].attached(); r.ocr = servo[0].read();
    #endif
    put(&r, sizeof r); put(tx, tx_n); put(way, 4 * way_n);
  }
  return 0;
}
#endif
