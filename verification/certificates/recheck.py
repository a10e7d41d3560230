"""What the checker says of certificates, and the folder that they are written to."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

from verification.checker.folder import Store
from verification.checker.reading import Rejected, Unknown
from workbench.contracts.certificate import FORMAT, Certificate, Json
from workbench.contracts.claim import NotCertified
from workbench.contracts.verdict import Verdict

FOLDER = "certificates"


class Recheck:
    """The checker, and the certificates that were handed to it.

    Where a certificate is ``demanded``, nothing is PROVED without one.
    """

    def __init__(self, *, demanded: bool = False) -> None:
        self.demanded = demanded
        self._texts: dict[tuple[str, str], str] = {}
        self._store = Store(self._read)

    def sentence(self, certificate: Certificate) -> str:
        """Return what the checker says that a certificate shows. Raises NotCertified where it accepts none."""
        for one in certificate.all():
            self._texts.setdefault(("proofs", one.name), _text(one.as_json()))
            for name, graph in one.graphs.items():
                self._texts.setdefault(("graphs", name), _text(graph))
        try:
            return self._store.shown(certificate.name).sentence
        except Unknown as error:
            raise NotCertified(str(error)) from None
        except Rejected as error:
            raise NotCertified(f"the checker did not accept its certificate: {error}") from None

    def _read(self, kind: str, name: str) -> object:
        if (kind, name) not in self._texts:
            raise Rejected(f"there is no certificate of the hash {name!r:.80}")
        content: object = json.loads(self._texts[kind, name])
        return content

    def write_into(self, folder: Path, verdicts: Iterable[Verdict]) -> None:
        """Write the certificates of verdicts, with all that they rest on, and their index."""
        place = folder / FOLDER
        kept = [one for one in verdicts if one.certificate]
        if not kept:
            return
        for kind in ("graphs", "proofs"):
            (place / kind).mkdir(parents=True, exist_ok=True)
        for (kind, name), text in self._texts.items():
            (place / kind / f"{name}.json").write_text(text, encoding="utf-8")
        claims: list[Json] = [
            {
                "claim": one.claim,
                "case": one.case,
                "controller": one.controller,
                "certificate": one.certificate,
                "sentence": one.sentence_hash,
            }
            for one in kept
        ]
        (place / "index.json").write_text(_text({"format": FORMAT, "claims": claims}), encoding="utf-8")


def _text(content: Json) -> str:
    return json.dumps(content, separators=(",", ":"), allow_nan=False)
