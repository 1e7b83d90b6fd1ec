"""The reports of libFuzzer as the evidence part reads them; the part itself runs in the evidence tier, as it needs clang."""

from tests.evidence.libfuzzer import libfuzzer

REPORT = """INFO: Running with entropic power schedule (0xFF, 100).
INFO: Loaded 1 modules   (457 inline 8-bit counters): 457 [0x5581, 0x5589),
#2\tINITED cov: 31 ft: 32 corp: 1/1b exec/s: 0 rss: 70Mb
#3000\tDONE   cov: 272 ft: 900 corp: 77/20Kb lim: 2048 exec/s: 100 rss: 71Mb
"""


def test_figures_are_those_of_the_last_line_and_findings_the_property_the_error_or_the_exit_code() -> None:
    assert libfuzzer.read(REPORT, 0) == libfuzzer.Run(3000, 272, 457, ())
    broken = REPORT + "property not held: status has a name (5, 4)\n==1== ERROR: libFuzzer: deadly signal\n"
    assert libfuzzer.read(broken, 77).findings == ("property not held: status has a name (5, 4)",)
    slow = libfuzzer.read("==1== ERROR: libFuzzer: timeout after 20 seconds\nTest unit written to ./x-timeout-1\n", 70)
    assert slow.findings == ("==1== ERROR: libFuzzer: timeout after 20 seconds (x-timeout-1)",)
    assert libfuzzer.read("", 1).findings == ("it ends with exit code 1",)
