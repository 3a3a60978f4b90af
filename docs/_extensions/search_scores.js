/* Sphinx's own scores of search results, except that the glossary comes before other texts. */
var Scorer = {
  score: ([page, , , , score]) => (page === "notation" && score > 0 ? score + 10 : score),
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
