"""Everything that touches the file system: hostile input in, atomic output out.

Input is read within size limits; XML is parsed without DTD, entities or network, and YAML without objects,
with aliases bounded. Output goes to a temporary file beside its target, is synced, and then renamed over it,
so that a failed or killed run leaves the old file whole. A command never writes over what it has read.
"""

from __future__ import annotations

from halpipe.core.files.folders import FOREIGN_FOLDER as FOREIGN_FOLDER
from halpipe.core.files.folders import MANIFEST as MANIFEST
from halpipe.core.files.folders import MANIFEST_KEY as MANIFEST_KEY
from halpipe.core.files.folders import make_folder as make_folder
from halpipe.core.files.folders import write_directory as write_directory
from halpipe.core.files.folders import write_new_folder as write_new_folder
from halpipe.core.files.protection import OUTPUT_IS_INPUT as OUTPUT_IS_INPUT
from halpipe.core.files.protection import STDIO as STDIO
from halpipe.core.files.protection import WRONG_ENDING as WRONG_ENDING
from halpipe.core.files.protection import is_input as is_input
from halpipe.core.files.protection import protecting_inputs as protecting_inputs
from halpipe.core.files.protection import refuse_inputs as refuse_inputs
from halpipe.core.files.protection import refuse_name as refuse_name
from halpipe.core.files.reading import CANNOT_READ as CANNOT_READ
from halpipe.core.files.reading import MAX_INPUT_BYTES as MAX_INPUT_BYTES
from halpipe.core.files.reading import TOO_LARGE as TOO_LARGE
from halpipe.core.files.reading import TOO_MUCH as TOO_MUCH
from halpipe.core.files.reading import SourceLines as SourceLines
from halpipe.core.files.reading import beginning_of as beginning_of
from halpipe.core.files.reading import find_inputs as find_inputs
from halpipe.core.files.reading import input_size as input_size
from halpipe.core.files.reading import is_ended as is_ended
from halpipe.core.files.reading import is_folder_without as is_folder_without
from halpipe.core.files.reading import open_input as open_input
from halpipe.core.files.reading import read_bytes as read_bytes
from halpipe.core.files.reading import read_own as read_own
from halpipe.core.files.reading import read_plain as read_plain
from halpipe.core.files.reading import refuse_more_than as refuse_more_than
from halpipe.core.files.reading import sha256 as sha256
from halpipe.core.files.recordings import folders_with as folders_with
from halpipe.core.files.recordings import mapped as mapped
from halpipe.core.files.recordings import plain_files as plain_files
from halpipe.core.files.writing import CANNOT_WRITE as CANNOT_WRITE
from halpipe.core.files.writing import FOREIGN_FILE as FOREIGN_FILE
from halpipe.core.files.writing import refuse_foreign as refuse_foreign
from halpipe.core.files.writing import remove_output as remove_output
from halpipe.core.files.writing import write_beside as write_beside
from halpipe.core.files.writing import write_output as write_output
from halpipe.core.files.writing import write_outputs as write_outputs
from halpipe.core.files.xml import BROKEN_XML as BROKEN_XML
from halpipe.core.files.xml import HAS_DOCTYPE as HAS_DOCTYPE
from halpipe.core.files.xml import LargeXmlParser as LargeXmlParser
from halpipe.core.files.xml import advice_for as advice_for
from halpipe.core.files.xml import parse_xml as parse_xml
from halpipe.core.files.yaml import BROKEN_YAML as BROKEN_YAML
from halpipe.core.files.yaml import Number as Number
from halpipe.core.files.yaml import YamlList as YamlList
from halpipe.core.files.yaml import YamlMap as YamlMap
from halpipe.core.files.yaml import is_shaped as is_shaped
from halpipe.core.files.yaml import json_decoder as json_decoder
from halpipe.core.files.yaml import load_json as load_json
from halpipe.core.files.yaml import parse_json as parse_json
from halpipe.core.files.yaml import parse_yaml as parse_yaml
