"""Foundation: exact time, quantities, diagnostics, records, files, options, programs, native libraries."""
