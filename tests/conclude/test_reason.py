"""Every reason has one sentence, and its code says what logic may want to know."""

from __future__ import annotations

import string
from typing import get_args

import pytest

from massprop_cli.conclude.reason import NOT_WHITE, REPORTED, SENTENCES, Cause, Code, Reason, VerdictReason


def test_each_code_has_a_sentence() -> None:
    assert list(SENTENCES) == [*get_args(VerdictReason), *get_args(Cause)]
    assert len(set(SENTENCES.values())) == len(SENTENCES) - len(REPORTED) + 1  # these bring theirs with them
    assert {*NOT_WHITE, *REPORTED} < {*SENTENCES}


@pytest.mark.parametrize("code", SENTENCES)
def test_a_sentence_names_each_of_its_data_and_is_none_without_it(code: Code) -> None:
    fields = {name: spec for _, name, spec, _ in string.Formatter().parse(SENTENCES[code]) if name}
    said = str(Reason.of(code, **{name: 0.125 if spec else f"<{name}>" for name, spec in fields.items()}))
    assert all((format(0.125, spec) if spec else f"<{name}>") in said for name, spec in fields.items())
    for name in fields:
        with pytest.raises(KeyError):
            str(Reason.of(code, **{other: 0.125 for other in fields if other != name}))


def test_what_a_user_named_is_no_template() -> None:
    assert str(Reason.of("named-fault", message="jet {0} {wants}")) == "jet {0} {wants}"
    assert str(Reason.of("contradiction", cause="{cause}")).endswith(": {cause}")
