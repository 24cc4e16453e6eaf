//! Matrices and nodes of finite element models, and what is said of files that are wrong.

use phipsi_formats::matrix_market::read_matrix_market;
use phipsi_formats::node_table::read_nodes;
use proptest::prelude::*;

const SPARSE: &str =
    "%%MatrixMarket matrix coordinate real general\n% springs\n2 2 4\n1 1 2\n1 2 -1\n2 1 -1.0D0\n2 2 1e0\n";

#[test]
fn formats_of_one_matrix_agree() {
    let texts = [
        SPARSE,
        "%%MatrixMarket matrix coordinate integer symmetric\n\n2 2 3\n1 1 2\n2 1 -1\n2 2 1\n",
        "%%MatrixMarket matrix coordinate real symmetric\n2 2 3\n1 1 2\n1 2 -1\n2 2 1\n",
        "%%MatrixMarket matrix array real general\n2 2\n2\n-1\n-1\n1\n",
        "%%matrixmarket matrix array double symmetric\n2 2\n2\n-1\n1\n",
    ];
    let all = texts.map(|text| read_matrix_market(text, "k.mtx").into_result(true).unwrap().0);
    for matrix in &all {
        assert_eq!(matrix.to_symmetric().unwrap(), all[0].to_symmetric().unwrap());
        assert_eq!(matrix.to_columns().unwrap(), [2.0, -1.0, -1.0, 1.0]);
    }
}

#[test]
fn mistakes_are_named_with_their_line() {
    let error = |text: &str| {
        let report = read_matrix_market(text, "k.mtx").report;
        let first = &report.errors[0];
        format!("{:?} {} | {} | {}", first.line, first.found, first.required, first.remedy)
    };
    let changed = |old: &str, new: &str| {
        assert!(SPARSE.contains(old));
        error(&SPARSE.replace(old, new))
    };
    assert!(error("").contains("MatrixMarket"));
    assert!(changed("real", "complex").starts_with("Some(1)"));
    assert!(changed("2 2 4", "2 2").starts_with("Some(3)"));
    assert!(changed("2 2 4", "2 2 5").contains("4 of 5 entries"));
    assert!(changed("2 2 4", "2 2 3").contains("more than 3 entries"));
    assert!(changed("1 2 -1", "1 3 -1").contains("a column of 1 to 2"));
    assert!(changed("1 2 -1", "0 2 -1").starts_with("Some(5)"));
    assert!(changed("1 2 -1", "1 2 nan").contains("a finite number"));
    assert!(changed("general\n% springs\n2 2 4", "symmetric\n\n2 3 4").contains("2 rows and 3 columns"));
    let skew = read_matrix_market(&SPARSE.replace("1 2 -1", "1 2 -2"), "k.mtx").value.unwrap();
    assert!(skew.to_symmetric().unwrap_err().to_string().contains("(1, 0) and (0, 1)"));
}

#[test]
fn nodes_have_labels_and_coordinates() {
    let (nodes, _) = read_nodes("# m\nn x y z\n7 0 0 1d-1\na;1;2;3\n", "n.csv").into_result(true).unwrap();
    assert_eq!(nodes.labels, ["7", "a"]);
    assert_eq!(nodes.positions, [[0.0, 0.0, 0.1], [1.0, 2.0, 3.0]]);
    let error = |text: &str| {
        let report = read_nodes(text, "n.csv").report;
        format!("{:?} {}", report.errors[0].line, report.errors[0].found)
    };
    assert!(error("a, 0, 0, 0\na, 1, 0, 0\n").contains("`a` a second time, first in line 1"));
    assert!(error("a, 0, 0, 0\nb, 1, 0\n").starts_with("Some(2)"));
    assert!(error("a, 0, 0, inf\n").starts_with("Some(1)"));
    assert!(error("").contains("no nodes"));
}

proptest! {
    /// No change of a byte makes a reader panic, and each gives a value or an error.
    #[test]
    fn damaged_files_are_read_or_refused(at in 0usize..SPARSE.len(), byte in 0u8..128, cut in 0usize..SPARSE.len()) {
        let mut bytes = SPARSE.as_bytes().to_vec();
        bytes[at] = byte;
        bytes.truncate(cut.max(at));
        let text = String::from_utf8(bytes).unwrap();
        let loaded = read_matrix_market(&text, "k.mtx");
        prop_assert_eq!(loaded.value.is_none(), !loaded.report.errors.is_empty());
        if let Some(matrix) = loaded.value {
            _ = (matrix.to_symmetric(), matrix.to_columns());
        }
        let loaded = read_nodes(&text, "n.csv");
        prop_assert_eq!(loaded.value.is_none(), !loaded.report.errors.is_empty());
    }
}
