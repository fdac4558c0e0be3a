// Which callback each program of the tables is. Written by halpipe.
#pragma once
#include <array>
#include <string>

#include "table_executor.hpp"

namespace table {

constexpr bool takes_newest = {{ "true" if is_newest else "false" }};   // of the waiting messages, or the oldest
constexpr size_t n_rows = {{ rows | length }};
static const Row rows[] = {
{% for r in rows %}
  {"{{ r.task }}", "{{ r.node }}", "{{ r.kind }}", "{{ r.subject }}", {{ r.period }}, {{ r.order }}, {{ r.wait }}, {{ r.missing }}},
{% endfor %}
};
static const std::array<std::string, {{ mode_names | length }}> mode_names = { {% for m in mode_names %}"{{ m }}", {% endfor %}};

}  // namespace table
