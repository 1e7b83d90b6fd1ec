"""CDF files are valid against ASAM's schema of CDF 2.0.0, as XML schema and as DTD.

The schema is copyright of ASAM and not part of this project. It comes from the source distribution of `asamint` (GPL), of which
nothing is installed or run.
"""

import io
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest
from lxml import etree

from codegen.export.calibration import cdf
from codegen.export.calibration.build import BuildCalibration
from tests import shared

GENERATED = Path(__file__).resolve().parents[3] / "generated"
SOURCE = "asamint==0.2.2"
NAMESPACE = b"""<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema" targetNamespace="http://www.w3.org/XML/1998/namespace">
<xs:attribute name="space" type="xs:NCName"/></xs:schema>"""
"""The part of xml.xsd that the schema uses: the copy beside it is not well-formed."""


class _Namespace(etree.Resolver):
    def resolve(self, url, _identifier, context):
        return self.resolve_string(NAMESPACE, context) if url.endswith("xml.xsd") else None


@pytest.fixture(scope="module")
def schemas(tmp_path_factory: pytest.TempPathFactory):
    folder = tmp_path_factory.mktemp("schema")
    command = [
        sys.executable,
        "-m",
        "pip",
        "download",
        "--quiet",
        "--no-deps",
        "--no-binary",
        SOURCE.partition("==")[0],  # only this one: what pip needs to read its metadata need not be built
        "-d",
        str(folder),
        SOURCE,
    ]
    subprocess.run(command, check=True)
    with tarfile.open(next(folder.glob("*.tar.gz"))) as packed:
        files = {Path(name).suffix: packed.extractfile(name).read() for name in packed.getnames() if "cdf_v2.0.0.sl." in name}
    parser = etree.XMLParser()
    parser.resolvers.add(_Namespace())
    return etree.XMLSchema(etree.fromstring(files[".xsd"], parser)), etree.DTD(io.BytesIO(files[".dtd"]))


@pytest.mark.parametrize("name", ["4ws2", "4ws2-paper", "feedforward", "proportional"])
def test_cdf_files_are_valid(name: str, schemas) -> None:
    folder = GENERATED / name if name.startswith("4ws2") else shared.build_folder(name)
    build = BuildCalibration.load(folder)
    tree = etree.fromstring(cdf.write(build.values, build.layout, "test"))
    for schema in schemas:
        assert schema.validate(tree), schema.error_log.last_error
    tree.find(".//SW-INSTANCE/CATEGORY").text = "NONE"
    assert not schemas[0].validate(tree)
