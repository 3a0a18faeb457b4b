/* What chip_teensy4.h takes of Teensyduino's core, with the names of its imxrt.h: declarations alone, to compile against. */
#pragma once
#include "../usb_serial.h"

enum { LOW, HIGH };
enum { INPUT, OUTPUT };
uint32_t micros(void);
uint32_t millis(void);
void pinMode(uint8_t pin, uint8_t mode);
void digitalWrite(uint8_t pin, uint8_t level);
volatile uint32_t *portSetRegister(uint8_t pin);
volatile uint32_t *portClearRegister(uint8_t pin);
uint32_t digitalPinToBitMask(uint8_t pin);

extern volatile uint32_t GPT1_CR, GPT1_PR, GPT1_SR, GPT1_IR, GPT1_OCR1, GPT1_CNT, CCM_CCGR1, CCM_CCGR3;
extern volatile uint16_t WDOG1_WCR, WDOG1_WSR, WDOG1_WMCR;
static const uint32_t CCM_CCGR_ON = 3;
constexpr uint32_t CCM_CCGR1_GPT1_BUS(uint32_t n) { return n << 20; }
constexpr uint32_t CCM_CCGR1_GPT1_SERIAL(uint32_t n) { return n << 22; }
constexpr uint32_t CCM_CCGR3_WDOG1(uint32_t n) { return n << 16; }
static const uint32_t GPT_CR_EN_24M = 1 << 10, GPT_CR_FRR = 1 << 9, GPT_CR_ENMOD = 1 << 1, GPT_CR_EN = 1;
static const uint32_t GPT_SR_OF1 = 1, GPT_IR_OF1IE = 1;
constexpr uint32_t GPT_CR_CLKSRC(uint32_t n) { return n << 6; }
constexpr uint32_t GPT_PR_PRESCALER24M(uint32_t n) { return n << 12; }
constexpr uint32_t GPT_PR_PRESCALER(uint32_t n) { return n; }
static const uint16_t WDOG_WCR_WDE = 1 << 2, WDOG_WCR_SRS = 1 << 4, WDOG_WCR_WDA = 1 << 5;
constexpr uint16_t WDOG_WCR_WT(uint32_t n) { return (uint16_t)(n << 8); }
enum IRQ_NUMBER_t { IRQ_GPT1 = 100 };
void attachInterruptVector(IRQ_NUMBER_t irq, void (*function)(void));
void NVIC_SET_PENDING(IRQ_NUMBER_t irq);
void NVIC_SET_PRIORITY(IRQ_NUMBER_t irq, uint8_t priority);
void NVIC_ENABLE_IRQ(IRQ_NUMBER_t irq);
