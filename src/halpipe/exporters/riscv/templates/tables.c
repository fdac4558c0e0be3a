/* The operation tables of {{ model }}: what the management core does, and when. Ticks of {{ tick }}. */
#include "halpipe.h"

#define AT(tick, order) ((uint64_t)(tick) << 2 | (order))
{% for program in programs %}

/* {{ loop.index0 }}: {{ program.task }}, version {{ program.version }}, on {{ units(program) }} */
static const hp_operation program_{{ loop.index0 }}[] = {
{%- for o in program.operations %}
    {AT({{ o.at }}, {{ o.key[1] }}), {{ o.source | hex }}, {{ o.target | hex }}, {{ o.size }}, {{ o.limit }}, OP_{{ o.kind | upper }}, {{ o.channel }}, {{ o.unit }}, 0, {{ o.rank }}, {{ o.ranks }}}, /* {{ o.what }} */
{%- endfor %}
};
{%- endfor %}

const hp_program hp_programs[] = {
{%- for program in programs %}
    {program_{{ loop.index0 }}, {{ program.operations | length }}, {{ program.units[0] }}},
{%- endfor %}
};
{% for table in tables if table.releases %}

/* {{ table.name }} */
static const hp_release table_{{ tables.index(table) }}[] = {
{%- for r in table.releases %}
    {{ "{" }}{{ r.tick }}, {{ r.program }}, 0}, /* {{ r.job.task }} {{ r.job.index }} */
{%- endfor %}
};
{%- endfor %}

const hp_table hp_tables[] = {
{%- for table in tables %}
    {{ "{" }}{% if table.releases %}table_{{ loop.index0 }}{% else %}0{% endif %}, {{ table.length }}, {{ table.releases | length }}, {{ table.target }}}, /* {{ table.name }} */
{%- endfor %}
};

const int16_t hp_switches[HP_MODES][HP_MODES] = {
{%- for row in switches %}
    {{ "{" }}{{ row | join(", ") }}},
{%- endfor %}
};

const hp_unit hp_units[HP_UNITS] = {
{%- for core, (address, size) in monitors %}
    {{ "{" }}{{ core.ispm.base | hex }}, {{ core.dspm.base | hex }}, {{ address | hex }}, {{ size }}}, /* {{ core.unit }} */
{%- endfor %}
};
