/* What chip_esp32.h takes of Espressif's Arduino core 3 and ESP-IDF 5: declarations alone, to compile against. */
#pragma once
#include <stddef.h>
#include <stdint.h>

#define IRAM_ATTR __attribute__((section(".iram1")))
#define HIGH 0x1
#define LOW 0x0
#define OUTPUT 0x03

#ifdef __riscv
extern "C" int vPortSetInterruptMask(void);
extern "C" void vPortClearInterruptMask(int mask);
#define portSET_INTERRUPT_MASK_FROM_ISR() vPortSetInterruptMask()
#define portCLEAR_INTERRUPT_MASK_FROM_ISR(mask) vPortClearInterruptMask(mask)
#else
extern "C" unsigned xPortEnterCriticalSection(void);
extern "C" void xPortLeaveCriticalSection(unsigned mask);
#define portSET_INTERRUPT_MASK_FROM_ISR() xPortEnterCriticalSection()
#define portCLEAR_INTERRUPT_MASK_FROM_ISR(mask) xPortLeaveCriticalSection(mask)
#endif

extern "C" {
void pinMode(uint8_t pin, uint8_t mode);
void digitalWrite(uint8_t pin, uint8_t val);
struct timer_struct_t;
typedef struct timer_struct_t hw_timer_t;
hw_timer_t *timerBegin(uint32_t frequency);
uint64_t timerRead(hw_timer_t *timer);
void timerAttachInterrupt(hw_timer_t *timer, void (*userFunc)(void));
void timerAlarm(hw_timer_t *timer, uint64_t alarm_value, bool autoreload, uint64_t reload_count);
}

class HardwareSerial {
public:
  size_t setRxBufferSize(size_t new_size);
  size_t setTxBufferSize(size_t new_size);
  void begin(unsigned long baud);
  int available(void);
  int availableForWrite(void);
  int read(void);
  size_t write(const uint8_t *buffer, size_t size);
};
extern HardwareSerial Serial;
