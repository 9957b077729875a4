"""Is the trial blind, sealed, repeatable, and plain about bad input?"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import signal
from concurrent.futures import Executor, Future
from pathlib import Path

import pytest

from bulgefit.cli import trial as verb
from bulgefit.cli.main import _Parser
from bulgefit.errors import InputError
from bulgefit.gap.diagnose import diagnose
from bulgefit.gap.prepare import MOST_FRAMES
from bulgefit.parallel.journal import Journal, journaled
from bulgefit.parallel.workers import open_executor
from bulgefit.trial import run as trial
from bulgefit.trial.foreign import FOREIGN
from bulgefit.trial.known import KNOWN
from bulgefit.trial.make import Recipe
from bulgefit.trial.plan import SHARES, filmed_closely, interpolated, plan, turned
from bulgefit.trial.run import run_trial, score_folder
from bulgefit.trial.score import score

SMALL = Recipe(frames=5, spacing=18.0, fineness=8)
#: Just enough for a diagnosis to judge.
JUDGED = Recipe(frames=12, spacing=12.0, fineness=16)


class Answer:
    """What a diagnosis gives."""

    def __init__(self, **answer):
        self.answer = answer

    def to_dict(self):
        return self.answer


def silent(tests, **options):
    """A diagnosis that finds nothing, and tells what it was given."""
    test = tests[0]
    names = [t.name for t in tests]
    given = {"names": names, "source": test.source, "process": os.getpid(), **options}
    return Answer(verdict="none", causes=[], given=given)


def broken(tests, **options):
    raise ValueError("too few points")


def killed_once(tests, **options):
    """A diagnosis of test_0001 kills its process in mid-run, the first time; tells who began."""
    (test,) = tests
    log = Path(test.source).parents[1] / "began"
    with log.open("a") as file:
        file.write(f"{test.name} {os.getpid()}\n")
    first = log.read_text().count("test_0001") == 1
    steps = []

    def say(what):
        steps.append(what)
        if test.name == "test_0001" and first and len(steps) == 3:
            os.kill(os.getpid(), signal.SIGKILL)

    return diagnose(tests, say=say, **options)


class Inline(Executor):
    """Runs in place."""

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


def small(tmp_path, number=3, **options):
    here = {"makers": Inline(), "executor": Inline()}
    options = {**here, "diagnose": silent, "recipe": SMALL, **options}
    return run_trial(number, 5, output=tmp_path / "trial", **options)


def test_plan_covers_all_and_repeats():
    chosen = plan(200, 1)
    assert chosen == plan(200, 1) != plan(200, 2)
    assert len(chosen) == 200
    for kind in ("none", "two", "three", "four", "five", "six", "beside", "family"):
        assert chosen.count(kind) == round(200 * SHARES[kind])
    assert all(chosen.count(effect) >= 2 for effect in (*KNOWN, *FOREIGN))
    strangers = sum(kind in (*FOREIGN, "beside") for kind in chosen)
    assert strangers == pytest.approx(200 / 3, abs=4)
    assert sum(SHARES.values()) == pytest.approx(1.0)
    assert len(interpolated(200, 1)) == 10
    assert interpolated(200, 1) != interpolated(200, 2)
    assert len(closely := filmed_closely(200, 1)) == 10
    assert all(MOST_FRAMES < frames <= 60 for frames in closely.values())
    assert closely != filmed_closely(200, 2)
    assert sorted(plan(4, 0, ["none", "clamp_slip"])) == ["clamp_slip"] * 2 + ["none"] * 2
    for number in range(1, 12):
        assert len(plan(number, 0)) == number


def test_seals_are_said_before_any_diagnosis(tmp_path):
    said = []

    def watch(tests, **options):
        assert any("sealed 3 truths" in line for line in said)
        return silent(tests)

    result = small(tmp_path, diagnose=watch, say=said.append)
    assert result["scores"]["tests"] == 3
    assert sorted(t["file"] for t in result["tests"]) == [f"test_000{i}.npz" for i in range(3)]
    for name, digest in result["meta"]["seals"].items():
        text = (tmp_path / "trial" / "sealed" / f"{name}.json").read_bytes()
        assert hashlib.sha256(text).hexdigest() == digest
        assert f"{digest}  sealed/{name}.json" in said
        assert json.loads((tmp_path / "trial" / "answers" / f"{name}.json").read_text())


def test_a_changed_truth_is_found_out(tmp_path):
    def cheat(tests, **options):
        path = tmp_path / "trial" / "sealed" / "test_0000.json"
        path.write_text(path.read_text().replace('"kind"', '"king"'))
        return silent(tests)

    with pytest.raises(InputError, match="seal is broken"):
        small(tmp_path, diagnose=cheat)


def test_a_family_is_diagnosed_together(tmp_path):
    result = small(tmp_path, 1, kinds=["family"])
    folder = tmp_path / "trial"
    names = ["test_0000_1", "test_0000_2", "test_0000_3"]
    assert sorted(path.stem for path in (folder / "tests").iterdir()) == names
    answer = json.loads((folder / "answers" / "test_0000.json").read_text())
    assert answer["given"]["names"] == names
    assert result["scores"]["families"]["of"] == 1
    assert result["tests"][0]["file"] == "test_0000"
    assert score_folder(folder)["scores"] == result["scores"]


def test_strike_takes_out_the_true_effect_alone(tmp_path):
    result = small(tmp_path, 2, kinds=["clamp_slip", "none"], strike=True)
    for line in result["tests"]:
        path = tmp_path / "trial" / "answers" / line["file"].replace("npz", "json")
        given = json.loads(path.read_text())["given"]
        if line["truth"]:
            assert set(KNOWN) - set(given["effects"]) == {"clamp_slip"}
            assert not line["right"]
        else:
            assert "effects" not in given
            assert line["right"]


def test_the_verb_strikes_from_the_catalogue_of_the_diagnosis(tmp_path, monkeypatch):
    """The dice may know effects that it does not know."""
    from bulgefit.gap.effects import CATALOGUE

    asked = {}

    def fake(number, seed, **options):
        asked.update(options)
        return {"scores": score([]), "tests": [], "meta": {}}

    monkeypatch.setattr(trial, "run_trial", fake)
    assert verb.run(arguments("--strike", "--output", str(tmp_path / "t"))) == 0
    assert asked["options"] == {"effects": [*CATALOGUE]}
    assert asked["recipe"] == Recipe(shrink=10.0)
    assert verb.run(arguments("--output", str(tmp_path / "u"), "--shrink", "2")) == 0
    assert asked["options"] is None
    assert asked["recipe"] == Recipe(shrink=2.0)


def test_only_a_trial_of_all_kinds_is_audible_mixed_and_turned():
    mixed = interpolated(40, 3)
    whole = trial._recipes(SMALL, 40, 3, whole=True)
    assert {i for i, recipe in enumerate(whole) if recipe.interpolated} == mixed
    closely = filmed_closely(40, 3)
    assert {i: r.frames for i, r in enumerate(whole) if r.frames != SMALL.frames} == closely
    angles = turned(40, 3)
    assert {i: r.mounted for i, r in enumerate(whole) if r.mounted} == angles
    assert (len(mixed), len(angles)) == (2, 4)
    assert all(recipe.audible for recipe in whole)
    assert trial._recipes(SMALL, 40, 3, whole=False) == [SMALL] * 40


def test_strike_keeps_to_the_effects_that_were_asked_for(tmp_path):
    asked = ["creep", "clamp_slip"]
    small(tmp_path, 1, kinds=["clamp_slip"], strike=True, options={"effects": asked})
    (answer,) = (tmp_path / "trial" / "answers").glob("*.json")
    assert json.loads(answer.read_text())["given"]["effects"] == ["creep"]


def test_a_failure_is_an_answer_that_is_not_right(tmp_path):
    result = small(tmp_path, 1, kinds=["none"], diagnose=broken)
    assert result["tests"][0]["error"] == "ValueError: too few points"
    assert result["scores"]["failed"] == 1
    assert result["scores"]["false_alarms"]["hits"] == 1


def test_same_seed_same_tests_in_fresh_processes(tmp_path):
    here = small(tmp_path / "a", 2)
    away = run_trial(
        2, 5, output=tmp_path / "b", workers=1, recipe=SMALL, diagnose=silent, say=print
    )
    assert here["meta"]["seals"] == away["meta"]["seals"]
    answer = json.loads((tmp_path / "b" / "answers" / "test_0001.json").read_text())
    assert answer["given"]["process"] != os.getpid()
    assert answer["given"]["source"].endswith("test_0001.npz")


def test_a_worker_of_a_cluster_that_dies_over_a_diagnosis(tmp_path, cluster):
    """Verdicts are those of one worker to the last bit; what was lost is diagnosed again."""
    options = {
        "number": 2,
        "kinds": ["clamp_slip", "none"],
        "recipe": JUDGED,
        "options": {"effects": ["clamp_slip", "rigid_motion"]},
    }
    alone, shared = tmp_path / "alone" / "trial", tmp_path / "shared" / "trial"
    small(alone.parent, diagnose=diagnose, **options)
    with open_executor(scheduler=cluster) as pool:
        small(shared.parent, diagnose=killed_once, executor=pool, **options)
    assert answers(shared) == answers(alone)
    assert {answer["verdict"] for answer in answers(alone).values()} == {"named", "none"}
    began = [line.split() for line in (shared / "began").read_text().splitlines()]
    killed, other = (process for name, process in began if name == "test_0001")
    assert killed != other


def answers(folder):
    """What was found of each test, without the times it took."""
    found = {}
    for path in sorted((folder / "answers").glob("*.json")):
        answer = json.loads(path.read_text())
        del answer["seconds"], answer["meta"]["seconds"]
        found[path.stem] = answer
    return found


@pytest.mark.parametrize("strike", [False, True])
def test_an_interrupted_trial_can_be_scored(tmp_path, strike):
    whole = small(tmp_path, 4, kinds=["clamp_slip", "none"], strike=strike)
    folder = tmp_path / "trial"
    again = score_folder(folder)
    assert again["scores"] == whole["scores"]
    assert again["tests"] == whole["tests"]
    (folder / "answers" / "test_0002.json").unlink()
    part = score_folder(folder)
    assert part["meta"]["answered"] == 3
    assert part["meta"]["number"] == 4
    assert part["tests"] == [t for t in whole["tests"] if t["file"] != "test_0002.npz"]


NO_OBJECT, CUT = b"[1, 2]", b'{"verdict": "none", "seco'
DAMAGE = {
    "no text": ("sealed/test_0000.json", b"\xff\xfe", "no text in UTF-8"),
    "no truth": ("sealed/test_0000.json", None, "cannot be read"),
    "half a seal": ("seals.txt", b"0123  sea", "not 1 lines of a SHA-256 and a file"),
    "no seal": ("seals.txt", b"", "not 1 lines"),
    "no seals": ("seals.txt", None, "cannot be read"),
    "no strike": ("trial.json", b'{"number": 1}', "strike is missing"),
    "no object": ("trial.json", NO_OBJECT, "no JSON object"),
    "nested": ("trial.json", b"[" * 100_000, "recursion"),
    "cut answer": ("answers/test_0000.json", CUT, "Unterminated string"),
    "no answer": ("answers/test_0000.json", NO_OBJECT, "no JSON object"),
    "no seconds": ("answers/test_0000.json", b'{"verdict": "none"}', "seconds is missing"),
    "no verdict": ("answers/test_0000.json", b'{"seconds": 1}', "verdict is missing"),
    "odd causes": (
        "answers/test_0000.json",
        b'{"verdict": "named", "seconds": 1, "causes": [1]}',
        "AttributeError",
    ),
    "odd probability": (
        "answers/test_0000.json",
        b'{"verdict": "named", "seconds": 1, "causes": [{"effect": "creep", "probability": "1"}]}',
        "TypeError",
    ),
}


@pytest.fixture(scope="module")
def trial_done(tmp_path_factory):
    """The folder of a trial of one test."""
    place = tmp_path_factory.mktemp("done")
    small(place, 1, kinds=["none"])
    return place / "trial"


@pytest.mark.parametrize("case", DAMAGE)
def test_a_damaged_file_is_named(case, trial_done, tmp_path):
    name, content, message = DAMAGE[case]
    folder = shutil.copytree(trial_done, tmp_path / "trial")
    if content is None:
        (folder / name).unlink()
    else:
        (folder / name).write_bytes(content)
    with pytest.raises(InputError, match=f"{name}: .*{message}"):
        score_folder(folder)


def test_only_the_folder_of_a_trial_is_scored(tmp_path):
    with pytest.raises(InputError, match="not the folder of a trial"):
        score_folder(tmp_path)


def test_refuses_a_folder_that_holds_something(tmp_path):
    (tmp_path / "trial").mkdir()
    (tmp_path / "trial" / "letter").write_text("dear")
    with pytest.raises(InputError, match="holds something"):
        small(tmp_path)


def arguments(*words):
    parser = _Parser(prog="bulgefit trial")
    verb.add_arguments(parser)
    args = parser.parse_args(list(words))
    args.quiet = True
    return args


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--number", "0"], "1 or more"),
        (["--seed", "-1"], "0 or more"),
        (["--shrink", "0.5"], "1 or more"),
        (["--effects", "gremlin"], "clamp_slip"),
        (["--effects", ","], "at least one"),
        (["--workers", "0"], "1 or more"),
    ],
)
def test_bad_input_is_one_line(tmp_path, words, said):
    with pytest.raises(InputError, match=said):
        verb.run(arguments(*words, "--output", str(tmp_path / "t")))
    assert not (tmp_path / "t").exists()


def test_json_that_would_replace_the_trial(tmp_path):
    small(tmp_path, 1)
    folder = tmp_path / "trial"
    for name in ("trial.json", "seals.txt", "answers/test_0000.json"):
        before = (folder / name).read_bytes()
        words = ["--output", str(folder), "--score", "--json", str(folder / name), "--force"]
        with pytest.raises(InputError, match="would replace what is read"):
            verb.run(arguments(*words))
        assert (folder / name).read_bytes() == before


def test_verb_prints_the_table_and_writes_json(tmp_path, monkeypatch, capsys):
    def fake(number, seed, **options):
        here = {"makers": Inline(), "executor": Inline(), "recipe": SMALL, "diagnose": silent}
        return run_trial(number, seed, **{**options, **here})

    monkeypatch.setattr(trial, "run_trial", fake)
    file = tmp_path / "result.json"
    words = ["--number", "2", "--effects", "none", "--output", str(tmp_path / "t")]
    assert verb.run(arguments(*words, "--json", str(file))) == 0
    assert "false alarms on clean tests" in capsys.readouterr().out
    result = json.loads(file.read_text())
    assert result["scores"]["false_alarms"]["hits"] == 0
    assert result["meta"]["versions"]["bulgefit"]


@pytest.mark.parametrize("pieces", [1, 4])
def test_an_interrupted_trial_goes_on(tmp_path, monkeypatch, pieces):
    """After one test was made, and after one of three was diagnosed."""
    asked = {"verb": "trial"}
    whole = small(tmp_path / "whole")
    begun = []

    def counted(tests, **options):
        begun.append(tests[0].name)
        return silent(tests, **options)

    folder = tmp_path / "parts" / "trial"
    options = {"diagnose": counted}
    with monkeypatch.context() as patch:
        keep, left = Journal.keep, [pieces]

        def interrupted(self, *piece):
            keep(self, *piece)
            left[0] -= 1
            if not left[0]:
                raise KeyboardInterrupt

        patch.setattr(Journal, "keep", interrupted)
        with pytest.raises(KeyboardInterrupt), journaled(tmp_path / "journal", asked):
            small(tmp_path / "parts", **options)
    with pytest.raises(InputError, match="holds something"):
        small(tmp_path / "parts", **options)
    begun.clear()
    # what a process that was killed in the midst of writing leaves
    (folder / "tests" / ".test_0002.0-1-abc.npz").write_bytes(b"half")
    with journaled(tmp_path / "journal", asked, resume=True):
        found = small(tmp_path / "parts", resume=True, **options)
    assert len(begun) == (3 if pieces == 1 else 2)
    for result in (whole, found):
        result["meta"].pop("seconds")
    assert found["meta"] == whole["meta"]
    for part in ("tests", "sealed"):
        for file in (tmp_path / "whole" / "trial" / part).iterdir():
            assert (folder / part / file.name).read_bytes() == file.read_bytes()
    assert not (tmp_path / "journal").exists()


def test_what_was_interrupted_before_anything_was_done_begins(tmp_path, monkeypatch):
    """Ctrl-C while the first test is made: there is a folder, and no journal yet."""
    from bulgefit.trial import run as module

    words = ["--number", "1", "--output", str(tmp_path / "trial")]
    monkeypatch.setattr(module, "_all", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        verb.run(arguments(*words))
    assert sorted(file.name for file in tmp_path.iterdir()) == ["trial"]
    assert (tmp_path / "trial" / "trial.json").is_file()
    with pytest.raises(InputError, match="holds something"):
        verb.run(arguments(*words))
    with pytest.raises(KeyboardInterrupt):  # it goes as far as before
        verb.run(arguments(*words, "--resume"))
    with pytest.raises(InputError, match="holds another trial"):
        verb.run(arguments(*words, "--seed", "1", "--resume"))
    # a trial that has ended is not done again
    (tmp_path / "trial" / "answers" / "test_0000.json").write_text("{}")
    with pytest.raises(InputError, match="holds something"):
        verb.run(arguments(*words, "--resume"))


def test_a_trial_goes_on_in_its_own_folder_alone(tmp_path):
    small(tmp_path)
    with pytest.raises(InputError, match="holds another trial; go on with what"):
        small(tmp_path, 2, resume=True)
    (tmp_path / "trial" / "notes.txt").touch()
    with pytest.raises(InputError, match=r"holds notes\.txt, which is no part of a trial"):
        small(tmp_path, resume=True)
