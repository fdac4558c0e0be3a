/* The tables of a schedule of model {{ model }}, written by halpipe. Times are nanoseconds. */
#include "dispatch.h"

{% for program in programs %}
static const char *const entries_{{ loop.index0 }}[] = { {% for e in program.entries %}"{{ e }}", {% endfor %}};
{% if program.moved_in %}
static const dispatch_move in_{{ loop.index0 }}[] = { {% for m in program.moved_in %}{"{{ m.symbol }}", {{ m.buffer }}, {{ m.size }}}, {% endfor %}};
{% endif %}
{% if program.moved_out %}
static const dispatch_move out_{{ loop.index0 }}[] = { {% for m in program.moved_out %}{"{{ m.symbol }}", {{ m.buffer }}, {{ m.size }}}, {% endfor %}};
{% endif %}
{% endfor %}
static const dispatch_program programs[] = {
{% for program in programs %}
  { .name = "{{ program.name }}", .library = "{{ program.library }}", .entries = entries_{{ loop.index0 }}, .n_entries = {{ program.entries | length }},
    .in = {% if program.moved_in %}in_{{ loop.index0 }}{% else %}0{% endif %}, .n_in = {{ program.moved_in | length }}, .out = {% if program.moved_out %}out_{{ loop.index0 }}{% else %}0{% endif %}, .n_out = {{ program.moved_out | length }} },
{% endfor %}
};

static const dispatch_buffer buffers[] = {
{% for buffer in buffers %}
  {"{{ buffer.name }}", {{ buffer.size }}},
{% endfor %}
  {0, 0},
};

{% for parts in all_parts %}
static const dispatch_part parts_{{ loop.index0 }}[] = { {% for p in parts %}{ {{- p.start }}, {{ p.first }}, {{ p.last }}}, {% endfor %}};
{% endfor %}

{% for worker in workers %}
{% set w = loop.index0 %}
{% for jobs in worker.tables %}
{% if jobs %}
static const dispatch_job jobs_{{ w }}_{{ loop.index0 }}[] = {
{% for j in jobs %}
  {.start = {{ j.start }}, .end = {{ j.end }}, .parts = parts_{{ j.parts }}, .n_parts = {{ j.n_parts }}, .program = {{ j.program }}, .job = {{ j.index }}},
{% endfor %}
};
{% endif %}
{% endfor %}
static const dispatch_rows rows_{{ w }}[] = {
{% for jobs in worker.tables %}
  { {%- if jobs %}jobs_{{ w }}_{{ loop.index0 }}, {{ jobs | length }}{% else %}0, 0{% endif %}},
{% endfor %}
};
{% endfor %}

static const dispatch_worker workers[] = {
{% for worker in workers %}
  {.task = "{{ worker.task }}", .unit = "{{ worker.unit }}", .units = "{{ worker.units }}", .cpu = {{ worker.cpu }}, .priority = {{ worker.priority }}, .refuge = {{ worker.refuge }}, .fault = {{ worker.fault }}, .tables = rows_{{ loop.index0 }}},
{% endfor %}
};

{% for number, rows in copies.items() %}
{% if rows %}
static const dispatch_copy copies_{{ number }}[] = { {% for c in rows %}{ {{- c.at }}, {{ c.source }}, {{ c.target }}, {{ c.size }}}, {% endfor %}};
{% endif %}
{% endfor %}
static const dispatch_table tables[] = {
{% for table in tables %}
{% set rows = copies.get(loop.index0) %}
  {.name = "{{ table.name }}", .length = {{ table.length }}, .rest = {{ table.rest }}, .from = {{ table.source }}, .to = {{ table.target }}{% if rows %}, .copies = copies_{{ loop.index0 }}, .n_copies = {{ rows | length }}{% endif %}},
{% endfor %}
};

static const int switches[] = { {% for s in switches %}{{ s }}, {% endfor %}};

const dispatch_plan plan = {
  .model = "{{ model }}", .parts = {{ parts }},
  .n_tables = {{ tables | length }}, .n_modes = {{ modes }}, .n_workers = {{ workers | length }}, .n_programs = {{ programs | length }},
  .n_buffers = {{ buffers | length }}, .levels = {{ levels }},
  .tables = tables, .switches = switches, .workers = workers, .programs = programs, .buffers = buffers,
{% if regulated %}
  .regulators = &bw_regulators,
{% endif %}
};
