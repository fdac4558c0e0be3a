"""Everything that touches the file system: hostile input in, atomic output out.

Input is read within size limits; XML is parsed without DTD, entities or network, and YAML without objects,
with aliases bounded. Output goes to a temporary file beside its target, is synced, and then renamed over it,
so that a failed or killed run leaves the old file whole. A command never writes over what it has read.
"""

from __future__ import annotations

from halpipe.core.files.folders import (
    FOREIGN_FOLDER,
    MANIFEST,
    MANIFEST_KEY,
    make_folder,
    write_directory,
    write_new_folder,
)
from halpipe.core.files.protection import (
    OUTPUT_IS_INPUT,
    STDIO,
    WRONG_ENDING,
    is_input,
    protecting_inputs,
    refuse_inputs,
    refuse_name,
)
from halpipe.core.files.reading import (
    CANNOT_READ,
    MAX_INPUT_BYTES,
    TOO_LARGE,
    TOO_MUCH,
    SourceLines,
    find_inputs,
    input_size,
    is_ended,
    is_folder_without,
    open_input,
    read_bytes,
    read_own,
    read_plain,
    refuse_more_than,
    sha256,
)
from halpipe.core.files.recordings import folders_with, mapped, plain_files
from halpipe.core.files.writing import (
    CANNOT_WRITE,
    FOREIGN_FILE,
    refuse_foreign,
    remove_output,
    write_beside,
    write_output,
    write_outputs,
)
from halpipe.core.files.xml import BROKEN_XML, HAS_DOCTYPE, LargeXmlParser, parse_xml
from halpipe.core.files.yaml import BROKEN_YAML, Number, YamlList, YamlMap, parse_json, parse_yaml

__all__ = [
    "BROKEN_XML",
    "BROKEN_YAML",
    "CANNOT_READ",
    "CANNOT_WRITE",
    "FOREIGN_FILE",
    "FOREIGN_FOLDER",
    "HAS_DOCTYPE",
    "MANIFEST",
    "MANIFEST_KEY",
    "MAX_INPUT_BYTES",
    "OUTPUT_IS_INPUT",
    "STDIO",
    "TOO_LARGE",
    "TOO_MUCH",
    "WRONG_ENDING",
    "LargeXmlParser",
    "Number",
    "SourceLines",
    "YamlList",
    "YamlMap",
    "find_inputs",
    "folders_with",
    "input_size",
    "is_ended",
    "is_folder_without",
    "is_input",
    "make_folder",
    "mapped",
    "open_input",
    "parse_json",
    "parse_xml",
    "parse_yaml",
    "plain_files",
    "protecting_inputs",
    "read_bytes",
    "read_own",
    "read_plain",
    "refuse_foreign",
    "refuse_inputs",
    "refuse_more_than",
    "refuse_name",
    "remove_output",
    "sha256",
    "write_beside",
    "write_directory",
    "write_new_folder",
    "write_output",
    "write_outputs",
]
