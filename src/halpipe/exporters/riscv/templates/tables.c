/* The operation tables of {{ model }}: what the management core does, and when. Ticks of {{ tick }}. */
#include "halpipe.h"

#define AT(tick, order) (((uint64_t)(tick) << 2U) | (order))
{% for program in programs %}

/* {{ loop.index0 }}: {{ program.task }}, version {{ program.version }}, on {{ units(program) }} */
static const hp_operation program_{{ loop.index0 }}[] = {
{%- for o in program.operations %}
    {AT({{ o.at }}U, {{ o.key[1] }}U), {{ o.source | hex }}U, {{ o.target | hex }}U, {{ o.size }}U, {{ o.limit }}U, OP_{{ o.kind | upper }}, {{ o.channel }}U, {{ o.unit }}U, 0U, {{ o.rank }}U, {{ o.ranks }}U}, /* {{ o.what }} */
{%- endfor %}
};
{%- endfor %}

{%- if drivers %}
{%- for name in drivers if name != "hp_request_mode" %}
extern void {{ name }}(void *data, uint64_t size);
{%- endfor %}

const hp_driver hp_drivers[HP_DRIVERS] = {
{%- for name in drivers %}
    {{ name }},
{%- endfor %}
};

{% endif -%}
const hp_program hp_programs[] = {
{%- for program in programs %}
    {program_{{ loop.index0 }}, {{ program.operations | length }}U, {{ program.slot }}U, {{ health.of(program.task) | join(", ") }}, {{ program.slots }}U},
{%- endfor %}
};

const hp_rule hp_rules[HP_RULES] = {
{%- for task, row in health.rules %}
    {{ "{" }}{{ row }}}, /* {{ task }} */
{%- else %}
    {0U, HP_NO_TABLE, 0U, 0U, 1U, 0U, 0U}, /* none */
{%- endfor %}
};
{% for table in tables if table.releases %}

/* {{ table.name }} */
static const hp_release table_{{ tables.index(table) }}[] = {
{%- for r in table.releases %}
    {{ "{" }}{{ r.tick }}U, {{ r.program }}U, 0U}, /* {{ r.job.task }} {{ r.job.index }} */
{%- endfor %}
};
{%- endfor %}

const hp_table hp_tables[] = {
{%- for table in tables %}
    {{ "{" }}{% if table.releases %}table_{{ loop.index0 }}{% else %}NULL{% endif %}, {{ table.length }}U, {{ table.releases | length }}U, {{ table.target }}U}, /* {{ table.name }} */
{%- endfor %}
};

const uint32_t hp_switches[HP_MODES][HP_MODES] = {
{%- for row in switches %}
    {{ "{" }}{% for index in row %}{{ "%dU" % index if index >= 0 else "HP_NO_TABLE" }}{% if not loop.last %}, {% endif %}{% endfor %}},
{%- endfor %}
};

const hp_unit hp_units[HP_UNITS] = {
{%- for core, (address, size) in monitors %}
    {{ "{" }}{{ core.ispm.base | hex }}U, {{ core.dspm.base | hex }}U, {{ address | hex }}U, {{ size }}U}, /* {{ core.unit }} */
{%- endfor %}
};
