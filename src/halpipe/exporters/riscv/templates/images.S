# What is loaded into the scratchpads, from the ELF files, each at its place in main memory.
    .section .images, "a"
{%- for file, offset, size, skip in pieces %}
{%- if skip %}
    .zero {{ skip }}
{%- endif %}
    .incbin "build/{{ file }}", {{ offset }}, {{ size }}
{%- endfor %}
