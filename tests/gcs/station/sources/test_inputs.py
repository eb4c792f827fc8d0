"""Hashes of what a run was made of."""

from gcs.station.sources.inputs import digests


def test_the_hash_is_that_of_the_bytes(tmp_path):
    file = tmp_path / "abc.csv"
    file.write_bytes(b"abc")
    assert digests({"flight": file}) == {
        "flight": {
            "file": str(file),
            "bytes": 3,  # FIPS 180-2, appendix B.1
            "sha256": "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad",
        }
    }
