"""What the program says of the machine that it runs on."""

from pathlib import Path

from scenes.running.packages import cpu_name, machine


def test_the_processor_has_a_name(tmp_path: Path) -> None:
    (tmp_path / "cpuinfo").write_text("processor\t: 0\nmodel name\t: Fast 9000\n")
    assert cpu_name(tmp_path / "cpuinfo") == "Fast 9000"
    assert cpu_name(tmp_path / "missing")
    assert machine()["cores"] >= 1
