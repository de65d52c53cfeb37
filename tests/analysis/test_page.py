"""The page template: escaping, marks and left-out parts."""

from __future__ import annotations

from pipeline.report.page import Drawing, Film, Page, Passage, Section, Table, render

SVG = '<svg viewBox="0 0 1 1"><path d="M0 0"/></svg>'


def page(*parts: Passage, headline: str = "headline", texts: tuple[str, ...] = ()) -> str:
    return render(Page("smoke", headline, (Section("Verdict", texts, parts),)))


def test_texts_and_cells_are_escaped_and_figures_are_not() -> None:
    table = Table(("rule",), (("fog >= 40 & sun < 0",),))
    text = page(
        Passage("<t>", "<p>", table, (Drawing(SVG, "<how>"),)), headline="<b>", texts=("<i>",)
    )
    assert "fog &gt;= 40 &amp; sun &lt; 0" in text
    assert SVG in text
    for raw in ("<t>", "<how>", '<p class="lead"><b>', "<i>"):
        assert raw not in text
    assert "&lt;how&gt;" in text


def test_verdict_cells_and_columns_are_marked() -> None:
    rows = (("adaptive", "8 / 150", "better"), ("random", "23 / 150", "worse"))
    text = page(
        Passage(table=Table(("version", "failures", "verdict"), rows, numbers=(1,), codes=(0,)))
    )
    assert '<td class=" better">better</td>' in text
    assert '<td class=" worse">worse</td>' in text
    assert '<td class="number ">8 / 150</td>' in text
    assert "<code>adaptive</code>" in text and "<code>8 / 150</code>" not in text


def test_empty_parts_are_left_out() -> None:
    body = page(Passage(text="only this")).partition("<main>")[2]
    assert "only this" in body
    for tag in ("<h3", "<table", "<figure", "<video", 'class="films"', "<details", "<ul"):
        assert tag not in body


def test_a_folded_table_opens_by_a_click_and_has_notes_below() -> None:
    table = Table(("version",), (("adaptive",),))
    body = page(Passage(table=table, folded="Every <pair>", notes=("first", "<second>"))).partition(
        "<main>"
    )[2]
    inside, _, after = body.partition("</details>")
    assert "<summary>Every &lt;pair&gt;</summary>" in inside and "<table>" in inside
    assert "<li>first</li><li>&lt;second&gt;</li>" in after


def test_film_keeps_its_data_addresses() -> None:
    film = Film(
        "F1-random-base-0-00001",
        "F1 · random",
        "R1, most typical failure.",
        "data:video/mp4;base64,AAAA+/=",
        "data:image/jpeg;base64,BBBB",
    )
    text = page(Passage("replays", replays=(film,)))
    assert 'src="data:video/mp4;base64,AAAA+/="' in text
    assert 'poster="data:image/jpeg;base64,BBBB"' in text
    assert "<strong>F1 · random</strong><br>R1, most typical failure." in text


def test_every_section_has_its_link() -> None:
    text = render(
        Page("smoke", "headline", (Section("Verdict", (), ()), Section("Search", (), ())))
    )
    for number, title in ((1, "Verdict"), (2, "Search")):
        assert f'<a href="#s{number}">{title}</a>' in text
        assert f'<h2 id="s{number}">{title}</h2>' in text
