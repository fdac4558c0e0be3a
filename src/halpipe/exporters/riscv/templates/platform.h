/* The target, generated from profile {{ profile.name }}. */
#ifndef PLATFORM_H
#define PLATFORM_H

#define HP_UNITS {{ cores | length }}U
#define HP_SLOTS {{ slots }}U /* for programs in progress: of each unit, and of each task whose jobs have gaps */
#define HP_MODES {{ modes }}U
#define HP_RULES {{ [health.rules | length, 1] | max }}U
#define HP_HISTORY {{ [health.events, 1] | max }}U /* events that all health rules count together */
{%- if drivers %}
#define HP_DRIVERS {{ drivers | length }}U
{%- endif %}
#define HP_CLINT {{ profile.clint | hex }}UL
#define HP_TICKS_PER_MS {{ [profile.timebase // 1000, 1] | max }}U
#define HP_DECISION {{ decision }}U /* ticks before the end of a hyperperiod at which mode requests are read */
#define HP_MARGIN {{ margin }}U /* ticks that a modelled execution ends before its deadline */
#define HP_ISPM_SIZE {{ profile.ispm.size | hex }}UL
#define HP_DSPM_SIZE {{ profile.dspm.size | hex }}UL

#define HP_UART_NS16550 0
#define HP_UART_SIFIVE 1
#define HP_UART_LITEX 2
#define HP_UART_NS16550X4 3
#define HP_UART_KIND HP_UART_{{ profile.uart_kind | upper }}
#define HP_UART {{ profile.uart | hex }}UL

#define HP_DMA_COPY 0
#define HP_DMA_PDMA 1
#define HP_DMA_KIND HP_DMA_{{ profile.dma.kind | upper }}
#define HP_DMA {{ profile.dma.base | hex }}UL
#define HP_DMA_STRIDE {{ profile.dma.stride | hex }}UL
#define HP_CHANNELS {{ profile.dma.channels }}U
{% if profile.finisher %}
#define HP_FINISHER {{ profile.finisher | hex }}UL
{% endif %}
{%- if profile.scratchpad %}
#define HP_SCRATCHPAD
#define HP_SHARED __attribute__((section(".shared"))) /* in main memory: start.S has the other harts read it */
{%- else %}
#define HP_SHARED
{%- endif %}
{%- if profile.watchdog %}
#define HP_WATCHDOG {{ profile.watchdog.address | hex }}UL
#define HP_WATCHDOG_VALUE {{ profile.watchdog.value | hex }}U
{%- endif %}
{%- if calibrate %}
#define HP_CALIBRATE
#define CALIBRATE_TURNS 5000
{%- endif %}
{%- if regulators and regulators.base %}
#define HP_REGULATORS {{ regulators.base | hex }}UL
#define HP_REGULATORS_LEAD {{ regulators.lead(profile.timebase) }}U /* ticks from START to the first table: a window and a cycle */
{%- endif %}
#define HP_CONTROL {{ memory.control | hex }}UL
#define HP_BUFFERS {{ memory.buffers_base | hex }}UL
#define HP_BUFFERS_END {{ memory.buffers_end | hex }}UL
#define HP_TRACE {{ memory.trace | hex }}UL
#define HP_TRACE_CAPACITY {{ trace }}U
#define HP_FAULTS {{ memory.faults | hex }}UL
#define HP_FAULT_CAPACITY {{ faults }}U

#endif
