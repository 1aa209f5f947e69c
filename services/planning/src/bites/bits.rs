//! Sets of small numbers as the words that are not empty: two bites that nearly coincide differ in few.

/// A set of numbers.
#[derive(Clone, Debug, Default)]
pub(super) struct Bits {
    /// Ascending by the first: which word, and its bits.
    words: Vec<(u32, u64)>,
}

impl Bits {
    pub(super) fn of(numbers: &[u32]) -> Self {
        let mut sorted = numbers.to_vec();
        sorted.sort_unstable();
        let mut words: Vec<(u32, u64)> = Vec::new();
        for number in sorted {
            let (word, bit) = (number / 64, 1 << (number % 64));
            match words.last_mut() {
                Some(last) if last.0 == word => last.1 |= bit,
                _ => words.push((word, bit)),
            }
        }
        Self { words }
    }

    pub(super) fn words(&self) -> &[(u32, u64)] {
        &self.words
    }

    /// Visits the numbers that are in this set and not in the other.
    pub(super) fn visit_without(&self, other: &Self, mut visit: impl FnMut(u32)) {
        let mut others = other.words.iter().peekable();
        for &(word, mut bits) in &self.words {
            while others.next_if(|(other, _)| *other < word).is_some() {}
            if let Some((_, theirs)) = others.next_if(|(other, _)| *other == word) {
                bits &= !theirs;
            }
            while bits != 0 {
                visit(word * 64 + bits.trailing_zeros());
                bits &= bits - 1;
            }
        }
    }
}

/// What numbers weigh, word by word, so that a word of which all or nothing counts is one look.
#[derive(Clone, Debug, Default)]
pub(super) struct Weights {
    words: Vec<WeighedWord>,
}

/// The numbers of one word that weigh something.
#[derive(Clone, Debug)]
pub(super) struct WeighedWord {
    pub(super) word: u32,
    bits: u64,
    /// What they weigh, in the order of the bits, and in all.
    weights: Vec<u32>,
    whole: u32,
}

impl Weights {
    pub(super) fn of(weighed: &[(u32, u32)]) -> Self {
        let mut sorted = weighed.to_vec();
        sorted.sort_unstable();
        let mut words: Vec<WeighedWord> = Vec::new();
        for (number, weight) in sorted {
            let (word, bit) = (number / 64, 1 << (number % 64));
            if words.last().is_none_or(|last| last.word != word) {
                words.push(WeighedWord {
                    word,
                    bits: 0,
                    weights: Vec::new(),
                    whole: 0,
                });
            }
            if let Some(last) = words.last_mut() {
                last.bits |= bit;
                last.weights.push(weight);
                last.whole += weight;
            }
        }
        Self { words }
    }

    pub(super) fn words(&self) -> &[WeighedWord] {
        &self.words
    }

    /// What all of them weigh.
    pub(super) fn whole(&self) -> u32 {
        self.words.iter().map(|word| word.whole).sum()
    }
}

impl WeighedWord {
    /// What the numbers weigh that are not in `gone`.
    pub(super) fn without(&self, gone: u64) -> u32 {
        let left = self.bits & !gone;
        if left == self.bits {
            return self.whole;
        }
        let (mut weight, mut left) = (0, left);
        while left != 0 {
            let below = (left & left.wrapping_neg()) - 1;
            weight += self.weights[(self.bits & below).count_ones() as usize];
            left &= left - 1;
        }
        weight
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_visited_is_the_difference_of_the_sets(
            ours in proptest::collection::btree_set(0u32..500, 0..80),
            theirs in proptest::collection::btree_set(0u32..500, 0..80),
        ) {
            let bits = |set: &std::collections::BTreeSet<u32>| {
                Bits::of(&set.iter().copied().collect::<Vec<_>>())
            };
            let mut visited = Vec::new();
            bits(&ours).visit_without(&bits(&theirs), |number| visited.push(number));
            let expected: Vec<u32> = ours.difference(&theirs).copied().collect();
            prop_assert_eq!(visited, expected);
        }

        #[test]
        fn what_is_left_weighs_what_its_numbers_weigh(
            weighed in proptest::collection::btree_map(0u32..300, 1u32..1000, 0..60),
            gone in proptest::collection::btree_set(0u32..300, 0..200),
        ) {
            let mut words = [0u64; 5];
            for number in &gone {
                words[*number as usize / 64] |= 1 << (number % 64);
            }
            let pairs: Vec<(u32, u32)> = weighed.iter().map(|(n, w)| (*n, *w)).collect();
            let weights = Weights::of(&pairs);
            let left = weights.words().iter().map(|part| part.without(words[part.word as usize]));
            let expected: u32 = weighed.iter().filter(|(n, _)| !gone.contains(n)).map(|(_, w)| w).sum();
            prop_assert_eq!(left.sum::<u32>(), expected);
            prop_assert_eq!(weights.whole(), weighed.values().sum::<u32>());
        }
    }
}
