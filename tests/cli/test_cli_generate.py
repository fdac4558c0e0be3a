"""``halpipe generate`` as its users run it."""

from halpipe.importers.native import read_model, read_schedule


def test_a_set_and_its_witness_are_written_and_agree(halpipe, folder):
    done = halpipe(
        "generate", "--tasks", 40, "--units", 4, "--utilisation", "70%", "--precedence", "1/4",
        "--seed", 3, "-o", "set.xml", "--witness", "witness.xml",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "units 70 % busy" in done.stderr
    assert len(read_model(str(folder / "set.xml")).tasks) == 40
    assert read_schedule(str(folder / "witness.xml")).modes[0].name == "all"
    assert halpipe("verify", "set.xml", "witness.xml").returncode == 0


def test_standard_output_gets_the_model_alone(halpipe):
    done = halpipe("generate", "--tasks", 6, "-o", "-", "--quiet")
    assert done.returncode == 0
    assert done.stdout.startswith("<?xml")
    assert done.stderr == ""


def test_a_share_that_cannot_be_read_is_wrong_usage(halpipe):
    done = halpipe("generate", "--utilisation", "much", "-o", "set.xml")
    assert done.returncode == 2
    assert "--utilisation" in done.stderr


def test_a_parameter_out_of_range_is_explained(halpipe, folder):
    done = halpipe("generate", "--gang", "0.9", "-o", "set.xml")
    assert done.returncode == 1
    assert "HAL0921" in done.stderr
    assert "at most 0.5" in done.stderr
    assert not (folder / "set.xml").exists()
